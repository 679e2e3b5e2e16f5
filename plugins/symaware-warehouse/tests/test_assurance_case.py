"""The assurance case of the case study: three goals, six solutions, of which one that becomes stale is found."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import symaware_cli as sa

# What the tests of this folder import may import NumPy first.
pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

PLUGIN = Path(__file__).parents[1]


@pytest.mark.slow
def test_a_solution_that_is_made_stale_on_purpose_is_found(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    for name in ("scenarios", "assurance"):
        shutil.copytree(PLUGIN / name, tmp_path / name)
    folder, scenario = tmp_path / "assurance", tmp_path / "scenarios" / "two-robots.yaml"
    claim = "P(safe) > 0.5; P(fetch_2) > 0.5 with confidence 0.8"
    sa.sweep(scenario, output=folder / "claimed", runs=4, claim=claim)
    assert sa.certify(folder / "claimed").is_established
    found = sa.falsify(scenario, "safe", seeds=2, runs=2, method="random")
    (folder / "search.json").write_text(json.dumps(found.to_json()))
    sa.load(scenario, seed=4).run(output=folder / "one.mcap")
    sa.load(scenario, seed=5).run(output=folder / "other.mcap")

    case = sa.assure(folder / "case.yaml", tmp_path / "assured", rows=1)
    assert len(case.document.goals) == 3
    assert dict(case.problems) == dict.fromkeys(("Sn1", "Sn2", "Sn3", "Sn4", "Sn5", "Sn6"))
    assert case.is_supported

    sa.load(scenario, seed=6).run(output=folder / "other.mcap")
    again = sa.verify_case(tmp_path / "assured", "arithmetic")
    assert {name: each for name, each in again.problems.items() if each} == {
        "Sn6": "stale: its file has changed since the case was written"
    }
    assert {name: again.statuses[name] for name in again.document.goals} == {
        "G1": "fails",
        "G2": "holds",
        "G3": "fails",
    }
    assert (tmp_path / "assured" / "case.svg").read_text().count("#c62828") > 0
