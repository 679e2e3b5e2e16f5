"""Tolerances of a comparison: numbers may differ as far as a file says, and nothing else may differ."""

from pathlib import Path

import pytest

from symaware_cli.evidence.tolerances import Tolerances
from symaware_cli.language import ScenarioError
from symaware_cli.log import LogDifference

TEXT = """\
symaware-tolerance: 1
channels:
  /agents/robot/control:
    absolute: 0.1
    columns: {turn_rate: {relative: 0.01}, "cov*": {absolute: 5.0}}
  "/world/*": {relative: 0.5}
  /contacts: {ignore: true}
  outcome: {absolute: 1.0}
"""


@pytest.fixture
def tolerances(tmp_path: Path) -> Tolerances:
    (tmp_path / "t.yaml").write_text(TEXT)
    return Tolerances.read(tmp_path / "t.yaml")


@pytest.mark.parametrize(
    ("topic", "element", "values", "allowed"),
    [
        ("/agents/robot/control", "speed", (1.0, 1.05), True),
        ("/agents/robot/control", "speed", (1.0, 1.2), False),
        ("/agents/robot/control", "turn_rate", (1.0, 1.05), False),
        ("/agents/robot/control", "turn_rate[3]", (100.0, 100.5), True),
        ("/agents/robot/control", "robot.1:covariance[2]", (1.0, 5.0), True),
        ("/world/robot/state", "x", (1.0, 1.9), True),
        ("/world/robot/state", "x", (1.0, -1.0), False),
        ("/world/robot/state", "x", (float("nan"), float("nan")), True),
        ("/world/robot/state", "x", (float("nan"), 1.0), False),
        ("/world/robot/state", "x", (float("inf"), 1e300), False),
        ("/world/robot/state", "x", (1.0, None), False),
        ("/world/robot/state", "", ("a message with 2 values", None), False),
        ("/world/robot/state", "name", ("a", "b"), False),
        ("/contacts", "", ("a contact", None), True),
        ("/agents/robot/state", "x", (1.0, 1.0000001), False),
        ("outcome", "specifications", ([{"robustness": 1.0}], [{"robustness": 1.5}]), True),
        ("outcome", "specifications", ([{"verdict": "a"}], [{"verdict": "b"}]), False),
        ("outcome", "flag", (True, False), False),
    ],
)
def test_a_difference_is_allowed_by_the_first_entry_about_its_channel(
    topic: str, element: str, values: tuple[object, object], allowed: bool, tolerances: Tolerances
) -> None:
    assert tolerances.allow(LogDifference(0, topic, "robot.0", element, values)) is allowed


@pytest.mark.parametrize(
    ("old", "new", "line", "column"),
    [
        ("absolute: 0.1", "absolut: 0.1", 4, 5),
        ("absolute: 0.1", "absolute: -0.1", 4, 15),
        ("{relative: 0.01}", "{relative: .nan}", 5, 37),
        ("symaware-tolerance: 1", "symaware-tolerance: 2", 1, 21),
    ],
)
def test_a_mistake_in_the_file_is_located(old: str, new: str, line: int, column: int, tmp_path: Path) -> None:
    (tmp_path / "t.yaml").write_text(TEXT.replace(old, new))
    with pytest.raises(ScenarioError) as caught:
        Tolerances.read(tmp_path / "t.yaml")
    span = caught.value.problems[0].span
    assert span is not None
    assert (span.line, span.column) == (line, column)
