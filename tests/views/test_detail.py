"""How much is shown of how many."""

import numpy as np
import pytest

from symaware_cli.log.error import LogError
from symaware_cli.views.detail import FEW, MANY, TABS, detail_of
from symaware_cli.views.views import GroupView, RunView


def run_view(**counts: int) -> RunView:
    group_views = {
        name: GroupView(
            name=name,
            agents=tuple(f"{name}.{row}" for row in range(count)) if count > 1 else (name,),
            colours=np.zeros((count, 3), np.uint8),
            shape=None,
            state=(("x", "m"), ("y", "m")),
            control_input=(),
            position=(0, 1),
            heading=None,
            state_topic=f"/world/{name}/state",
        )
        for name, count in counts.items()
    }
    return RunView("test", 1, group_views, {}, (), 30.0)


def test_of_a_few_everything_is_shown_and_each_has_a_tab() -> None:
    detail = detail_of(run_view(robot=FEW))
    assert len(detail.focus) == FEW
    assert detail.labels
    assert detail.awareness
    assert detail.curves
    assert "tabs for all agents" in detail.words


def test_of_more_a_few_have_tabs_and_labels() -> None:
    detail = detail_of(run_view(robot=FEW + 1))
    assert detail.focus == tuple(f"robot.{row}" for row in range(TABS))
    assert not detail.labels
    assert detail.awareness
    assert not detail.curves
    assert "--agents chooses" in detail.words


def test_of_a_crowd_only_the_awareness_of_those_with_a_tab_is_shown() -> None:
    detail = detail_of(run_view(robot=MANY + 1))
    assert not detail.awareness
    assert "intents and uncertainties of robot.0, robot.1, robot.2 and robot.3 only" in detail.words


def test_one_agent_is_spoken_of_in_the_singular() -> None:
    assert detail_of(run_view(car=1)).words.startswith("1 agent:")


def test_a_group_stands_for_its_agents_and_an_agent_for_itself_once() -> None:
    detail = detail_of(run_view(robot=2, car=1), ["car", "robot", "robot.1"])
    assert detail.focus == ("car", "robot.0", "robot.1")


def test_the_tab_of_the_only_one_that_was_asked_for_is_in_front() -> None:
    assert detail_of(run_view(robot=3), ["robot.1"]).single
    assert not detail_of(run_view(robot=3)).single


def test_a_thousand_tabs_are_too_many() -> None:
    detail = detail_of(run_view(robot=1000), ["robot"])
    assert len(detail.focus) == FEW
    assert f"the first {FEW} of 1000" in detail.words


def test_an_unknown_name_is_reported_with_the_nearest() -> None:
    with pytest.raises(LogError, match=r"there is no agent 'robt.1'; did you mean 'robot.1'\?"):
        detail_of(run_view(robot=3), ["robt.1"])
