"""What agents that take no part leave to the others of their group."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from simulating import Team, present, simulation

from symaware_cli import Log, open_log
from symaware_cli.core import AgentGroup, Tracks
from symaware_cli.engine.runtime.protected_rows import ProtectedRows
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

STEP = 50_000_000


@pytest.fixture
def log(doubles: Path, tmp_path: Path) -> Callable[[bool, str], Log]:
    """The log of three robots that meet while a fourth, far away, fails or does not, and is isolated for it."""

    def run(fails: bool, on_failure: str) -> Log:
        trip = {"use": "doubles.fault", "with": {"agent": "robot.3", "at": 0.5 if fails else 1e9}}
        document = {
            "symaware": 1,
            "name": "held",
            "run": {"duration": 2.0},
            "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
            "agents": {
                "robot": {
                    "count": 4,
                    "entity": {"shape": {"circle": {"radius": 0.3}}},
                    "model": {"use": "single-integrator"},
                    "state": [[-2.0, 0.0], [2.0, 0.1], [0.0, 2.0], [50.0, 0.0]],
                    "knowledge": {"goal": [[2.0, 0.0], [-2.0, 0.0], [0.0, -2.0], [60.0, 0.0]]},
                    "components": {
                        "see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.1}},
                        "believe": {"use": "uncertainty.gaussian", "with": {"acceleration_noise": 0.5}},
                        "fear": {"use": "risk.collision", "with": {"horizon": 2.0}},
                        "trip": {**trip, "on_failure": on_failure},
                        "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
                    },
                }
            },
        }
        path = tmp_path / "held.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        execute(build(path), tmp_path / "held.mcap")
        return open_log(tmp_path / "held.mcap")

    return run


def test_an_agent_that_is_isolated_does_not_take_the_covariances_from_the_others(
    log: Callable[[bool, str], Log],
) -> None:
    uncertain = {}
    for fails in (False, True):
        run = log(fails, "isolate")
        assert [event.time for event in run.events() if event.name == "terminated"] == [10 * STEP] * fails
        risk = [run.series(f"robot.{row}", "risk") for row in range(3)]
        beliefs = run.beliefs("robot.0", "robot.1")
        uncertain[fails] = [each.values for each in risk], beliefs.covariances
        assert (beliefs.covariances[-1].diagonal()[:2] > 0.0).all()
    for alone, held in zip(uncertain[False][0], uncertain[True][0], strict=True):
        np.testing.assert_array_equal(alone, held)
        assert held.max() > 0.1
    np.testing.assert_array_equal(uncertain[False][1], uncertain[True][1])


def test_an_isolated_agent_reports_no_events(doubles: Path, tmp_path: Path) -> None:
    trip = {"use": "doubles.fault", "with": {"agent": "robot.0"}, "on_failure": "isolate"}
    document = {
        "symaware": 1,
        "name": "left",
        "run": {"duration": 4.0},
        "environment": {"use": "kinematic"},
        "agents": {
            "leader": {
                "model": {"use": "single-integrator"},
                "state": [1.0, 0.0],
                "knowledge": {"goal": [50.0, 0.0]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 2.0}},
                },
            },
            "robot": {
                "count": 2,
                "model": {"use": "single-integrator"},
                "state": [[0.0, 0.0], [0.0, 1.0]],
                "knowledge": {"offset": [[-1.0, 0.0], [-1.0, 1.0]]},
                "components": {
                    "trip": trip,
                    "see": {"use": "perception.range", "with": {"range": 4.0}},
                    "steer": {"use": "control.follow", "with": {"leader": "leader", "speed": 0.1}},
                },
            },
        },
    }
    path = tmp_path / "left.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    execute(build(path), tmp_path / "left.mcap")
    lost = [event.source for event in open_log(tmp_path / "left.mcap").events() if event.name == "leader-lost"]
    assert lost == ["agents.robot.1.steer"]


@pytest.fixture
def group() -> AgentGroup:
    """Three agents of one group."""
    [group] = simulation({"robot": Team(count=3)}).groups
    return group


def tracks(time: int, *observers: int, covariances: bool = True) -> Tracks:
    """Tracks of the others that some agents see, one each, that tell when they were made."""
    count = len(observers)
    return Tracks.of(
        time,
        3,
        np.array(observers, np.intp),
        (np.array(observers, np.intp) + 1) % 3,
        np.full((count, 2), float(time)),
        np.zeros((count, 2)),
        covariances=np.full((count, 4, 4), float(time)) if covariances else None,
        ages=np.zeros(count),
    )


def test_held_rows_keep_their_tracks(group: AgentGroup) -> None:
    group.awareness.seen = tracks(1, 0, 1, 2)
    with ProtectedRows(group, [1]):
        group.awareness.seen = tracks(2, 0, 1, 2)
    merged = group.awareness.tracks
    assert merged is not None
    assert merged.positions[:, 0].tolist() == [2.0, 1.0, 2.0]
    assert present(merged.covariances)[:, 0, 0].tolist() == [2.0, 1.0, 2.0]


def test_tracks_without_covariances_have_zeros(group: AgentGroup) -> None:
    group.awareness.seen = tracks(1, 1, covariances=False)
    with ProtectedRows(group, [1]):
        group.awareness.seen = tracks(2, 0, 2)
    assert present(present(group.awareness.tracks).covariances)[:, 0, 0].tolist() == [2.0, 0.0, 2.0]


def test_held_rows_without_tracks_add_no_covariances(group: AgentGroup) -> None:
    group.awareness.seen = tracks(1, 0, 2)
    with ProtectedRows(group, [1]):
        group.awareness.seen = tracks(2, 0, 1, 2, covariances=False)
    assert present(group.awareness.tracks).observers.tolist() == [0, 2]
    assert present(group.awareness.tracks).covariances is None


def test_held_rows_see_nobody_if_they_have_not_seen_anybody_yet(group: AgentGroup) -> None:
    with ProtectedRows(group, [1]):
        group.awareness.seen = tracks(2, 0, 1, 2)
    assert present(group.awareness.tracks).observers.tolist() == [0, 2]


def test_beliefs_of_held_agents_grow_old(group: AgentGroup) -> None:
    for source in ("seen", "received"):
        setattr(group.awareness, source, tracks(0, 0, 1, 2))
        with ProtectedRows(group, [1]):
            setattr(group.awareness, source, tracks(2_000_000_000, 0, 1, 2))
        assert getattr(group.awareness, source).ages.tolist() == [0.0, 2.0, 0.0]


def test_a_component_finds_its_output_again_after_rows_were_restored() -> None:
    team = Team(count=3)
    run = simulation({"robot": team})
    (group,) = run.groups
    written = np.ones((3, 2))
    with ProtectedRows(group, [1]):
        group.control_input = written
        mine = group.control_column.writes
    np.testing.assert_array_equal(group.control_input, [[1.0, 1.0], [0.0, 0.0], [1.0, 1.0]])
    assert group.control_column.writes == mine
    group.control_column.set_row(0, np.zeros(2))
    assert group.control_column.writes != mine


def test_received_information_ages_even_if_an_agent_of_the_group_has_stopped(tmp_path: Path) -> None:
    document = {
        "symaware": 1,
        "name": "silence",
        "run": {"duration": 2.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "robot": {
                "count": 3,
                "model": {"use": "single-integrator"},
                "state": [[0.0, 0.0], [3.0, 0.0], [6.0, 0.0]],
                "components": {
                    "see": {"use": "perception.self"},
                    "tell": {"use": "communication.state"},
                    "hear": {"use": "communication.inbox"},
                },
            }
        },
        "faults": {
            "halt": {"at": 0.5, "stop": "robot.2"},
            "hush": {"at": 1.0, "drop": {"sender": "robot.1"}},
        },
    }
    path = tmp_path / "silence.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    execute(build(path), tmp_path / "silence.mcap")
    beliefs = open_log(tmp_path / "silence.mcap").beliefs("robot.0", "robot.1")
    assert beliefs.ages[-1] == pytest.approx(0.9, abs=0.11)
