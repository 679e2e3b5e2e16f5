"""What the guide shows does what it says."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from exported import PARQUET, export_tables

from symaware_cli.log.reader import open_log

GUIDE = CHECKOUT / "docs" / "export.md"


def test_the_functions_of_the_guide_read_exports(noisy: Path, tmp_path: Path) -> None:
    log = open_log(noisy)
    export_tables(log, tmp_path / "tables", PARQUET)
    guide: dict[Any, Any] = {}
    for block in re.findall(r"(?ms)^```python\n(.*?)^```$", GUIDE.read_text(encoding="utf-8")):
        exec(block, guide)
    units = guide["units"](tmp_path / "tables" / "state" / "turner.parquet")
    assert units == {"time": "s", "agent": "", "x": "m", "y": "m", "heading": "rad"}
    errors = guide["estimation_errors"](tmp_path / "tables", "turner")
    believed, true = log.series("turner", "state"), log.series("turner", "world")
    expected = np.linalg.norm(believed.values[:, :2] - true.values[: len(believed.times), :2], axis=1)
    assert [agent for _, agent, _ in errors] == ["turner"] * len(expected)
    assert [distance for *_, distance in errors] == pytest.approx(expected.tolist())
    assert max(expected) > 0.1
