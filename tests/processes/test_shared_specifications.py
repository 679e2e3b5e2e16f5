"""In a run that several processes share the host says what becomes of specifications, as one process alone would."""

from pathlib import Path

import pytest
from checkout import CHECKOUT
from spreading import Spread, alone, differences

from symaware_cli.language.build import build
from symaware_cli.processes.distribution import participant
from symaware_cli.processes.distribution_error import DistributionError
from symaware_cli.processes.place import Place

SCENARIO = CHECKOUT / "scenarios" / "patrol.yaml"
SHORT = ("--set", "run.duration=12")


def test_a_merged_log_has_the_specifications_of_a_run_in_one_process(tmp_path: Path) -> None:
    spread = Spread(tmp_path, SCENARIO, *SHORT)
    try:
        spread.host("--only", "robot.0,robot.1")
        spread.member("other", "robot.2")
        assert spread.end() == [0, 0]
        merged = spread.merged()
    finally:
        spread.close()
    one = alone(tmp_path, SCENARIO, *SHORT)
    assert differences(merged, one) == {}
    assert [each.verdict.tolist() for each in merged.specifications.values()] == [[1, 1, 1], [0, 0, 0], [1, 1, 1]]


def test_specifications_about_beliefs_are_refused(tmp_path: Path) -> None:
    built = build(SCENARIO.with_name("shortcut.yaml"))
    with pytest.raises(DistributionError, match="the specification `told` is about beliefs"):
        participant(built, Place.host(0, ["robot.0"]))
