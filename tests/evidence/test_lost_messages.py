"""Links with lost or late messages are found by repeating the run."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli.evidence.branch_changes import BranchError
from symaware_cli.evidence.causes.lost_messages import has_messages, links_with_losses
from symaware_cli.language.build import Built, build


def talk(folder: Path, channel: dict[str, Any], **components: Any) -> Built:
    """Three agents, of which the first two are in reach of each other, send each other messages."""
    share = {"send": {"use": "communication.broadcast"}, "hear": {"use": "communication.inbox"}}
    content = {
        "symaware": 1,
        "name": "talk",
        "run": {"duration": 1.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "topology": {"use": "range", "with": {"range": 2.0}, "channel": channel},
        "agents": {
            "robot": {
                "count": 3,
                "model": {"use": "single-integrator"},
                "state": [[0, 0], [1, 0], [9, 0]],
                "components": {"see": {"use": "perception.self"}, **(components or share)},
            }
        },
    }
    (folder / "talk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return build(folder / "talk.yaml")


LINKS = [("robot.0", "robot.1"), ("robot.1", "robot.0")]


def found(built: Built, begin: float = 0.0, end: float = 1.0) -> list[tuple[tuple[str, str], int, int]]:
    """The links, with the numbers of lost and of late messages."""
    return [((each.sender, each.receiver), each.lost, each.late) for each in links_with_losses(built, begin, end)]


def test_links_have_the_messages_that_the_channel_lost_and_none_of_those_out_of_reach(tmp_path: Path) -> None:
    assert found(talk(tmp_path, {})) == []
    every = found(talk(tmp_path, {"loss": 1.0}))
    assert [(link, late) for link, _, late in every] == [(link, 0) for link in LINKS]
    half = found(talk(tmp_path, {"loss": 1.0}), begin=0.5)
    # Turns are at each step of 0.1 s, and what is sent from 0.9 s on need not arrive before the end.
    assert [lost for _, lost, _ in every] == [9, 9]
    assert [lost for _, lost, _ in half] == [4, 4]
    some = found(talk(tmp_path, {"loss": 0.5}))
    assert all(0 < lost < 9 for _, lost, _ in some)


def test_messages_are_late_that_come_after_the_next_step_or_not_before_the_end(tmp_path: Path) -> None:
    assert found(talk(tmp_path, {"delay": 0.05})) == []
    assert found(talk(tmp_path, {"delay": 0.25})) == [(link, 0, 9) for link in LINKS]
    assert found(talk(tmp_path, {"delay": 60.0})) == [(link, 0, 9) for link in LINKS]


def test_a_run_without_readers_of_messages_has_none(tmp_path: Path) -> None:
    assert has_messages(talk(tmp_path, {}))
    assert not has_messages(talk(tmp_path, {}, send={"use": "communication.broadcast"}))


def test_a_run_that_fails_when_it_is_repeated_is_reported(doubles: Path, tmp_path: Path) -> None:
    failing = {"use": "doubles.thinker", "with": {"at": 0.0}}
    with pytest.raises(BranchError, match=r"cannot be repeated: .*on purpose"):
        links_with_losses(talk(tmp_path, {}, think=failing), 0.0, 1.0)
