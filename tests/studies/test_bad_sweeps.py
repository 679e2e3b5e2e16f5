"""tests/studies/bad/ holds broken files of sweeps, each beside the report that `symaware sweep` prints for it.

To write the reports anew after a wording has changed: `SYMAWARE_WRITE_REPORTS=1 pytest
tests/studies/test_bad_sweeps.py`, then read the difference.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from sweeping import SCENARIO, symaware

BAD = Path(__file__).parent / "bad"
WRITE = bool(os.environ.get("SYMAWARE_WRITE_REPORTS"))


@pytest.mark.parametrize("name", sorted(path.name for path in BAD.glob("*.yaml")))
def test_a_broken_sweep_gives_exactly_the_expected_report_and_no_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(SCENARIO)
    Path(name).write_bytes((BAD / name).read_bytes())
    said = symaware("sweep", name, "-o", "out", status=2)
    if WRITE:
        (BAD / f"{name}.expected").write_text(said, encoding="utf-8")
    assert said == (BAD / f"{name}.expected").read_text(encoding="utf-8")
    assert not Path("out").exists()
