"""Faults that a scenario asks for: each does what it says, to whom it says, for as long as it says, in both modes."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from symaware_cli import Log, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError

MODES = pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
STEP = 50_000_000


@pytest.fixture
def ran(tmp_path: Path) -> Callable[..., Log]:
    """Run four robots that go to their goals, with faults; the log."""

    def run(
        faults: Mapping[str, Any],
        mode: str = "synchronous",
        see: str = "perception.omniscient",
        duration: float = 3.0,
        more: Mapping[str, Any] | None = None,
        topology: Mapping[str, Any] | None = None,
        recording: Mapping[str, Any] | None = None,
        **component: Any,
    ) -> Log:
        steer = {"use": "control.go-to-goal", "with": {"speed": 1.0, "tolerance": 0.1}, **component}
        document = {
            "symaware": 1,
            "name": "faults",
            "seed": 3,
            "run": {"mode": mode, "duration": duration},
            "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
            "agents": {
                "robot": {
                    "count": 4,
                    "model": {"use": "single-integrator"},
                    "state": [[0, 0], [0, 1], [0, 2], [0, 3]],
                    "knowledge": {"goal": [[5, 0], [5, 1], [5, 2], [5, 3]]},
                    "components": {
                        "see": {"use": see, **({"with": {"range": 9}} if "range" in see else {})},
                        **(more or {}),
                        "steer": steer,
                    },
                }
            },
            "faults": faults,
            **({"topology": topology} if topology else {}),
            "recording": recording or {},
        }
        path = tmp_path / "faults.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        summary = execute(build(path), tmp_path / "faults.mcap")
        assert summary.status == "finished", summary.failure
        return open_log(tmp_path / "faults.mcap")

    return run


def world(log: Log, agent: int) -> NDArray[np.float64]:
    return log.series(f"robot.{agent}", "world").values


def told(log: Log) -> list[tuple[float, str, str]]:
    return [(event.time / 1e9, event.name, event.source) for event in log.events() if event.name.startswith("fault")]


@MODES
def test_a_stopped_agent_stands_still_and_begins_anew(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"dead": {"at": 1.0, "for": 0.5, "stop": "robot.2"}}, mode)
    assert told(log) == [(1.0, "fault", "agents.robot.2"), (1.5, "fault-over", "agents.robot.2")]
    assert [event.source for event in log.events() if event.name == "terminated"] == ["agents.robot.2"]
    moved = np.diff(world(log, 2)[:, 0])
    assert moved[:20] == pytest.approx(0.05)
    assert moved[20:30] == pytest.approx(0.0)
    assert moved[30:] == pytest.approx(0.05)
    assert np.diff(world(log, 1)[:, 0]) == pytest.approx(0.05)


@MODES
def test_a_stop_without_an_end_lasts(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"dead": {"at": 1.0, "stop": "robot"}}, mode)
    assert [event.source for event in log.events() if event.name == "terminated"] == [
        f"agents.robot.{row}" for row in range(4)
    ]
    assert world(log, 0)[-1, 0] == pytest.approx(1.0)


@MODES
def test_a_frozen_controller_holds_its_last_input_and_its_neighbours_theirs(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"stuck": {"at": 1.0, "freeze": "robot.1.steer"}}, mode, duration=8.0)
    # It drives past its goal at 5, where the others stop.
    assert world(log, 1)[-1, 0] == pytest.approx(8.0)
    assert world(log, 0)[-1, 0] == pytest.approx(5.0, abs=0.1)


@MODES
def test_a_frozen_perception_leaves_the_belief_as_it_was(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"stuck": {"at": 1.0, "for": 1.0, "freeze": "robot.1.see"}}, mode)
    believed, truth = log.series("robot.1", "state"), log.series("robot.1", "world")
    frozen = believed.values[(believed.times >= 1.0e9) & (believed.times < 2.0e9)]
    assert np.ptp(frozen, axis=0) == pytest.approx([0.0, 0.0]) if len(frozen) else True
    assert believed.values[-1] == pytest.approx(truth.values[-1], abs=0.06)


@MODES
@pytest.mark.parametrize("see", ["perception.omniscient", "perception.range"])
def test_a_blind_sensor_sees_nobody_and_feels_itself(
    mode: str, see: str, ran: Callable[..., Log], tmp_path: Path
) -> None:
    more = {"risk": {"use": "risk.time-to-collision", "with": {"reach": 9.0, "horizon": 5.0}}}
    log = ran({"fog": {"at": 1.0, "for": 1.0, "blind": "robot.0.see"}}, mode, see, more=more)
    known = {}
    for message in log.messages(["/agents/robot/awareness"]):
        content = message.decode()
        if content.world:
            continue
        lengths = np.broadcast_to(content.lengths, 4) if len(content.lengths) == 1 else content.lengths
        known[message.time / 1e9] = [int(each) for each in lengths]
    during = [lengths for time, lengths in known.items() if 1.0 <= time < 2.0]
    assert during
    assert all(lengths == [0, 3, 3, 3] for lengths in during)
    if see == "perception.range":
        assert known[2.0] == known[0.95] == [3, 3, 3, 3]
    believed = log.series("robot.0", "state")
    assert believed.values[-1] == pytest.approx(log.series("robot.0", "world").values[-2], abs=1e-9)


@MODES
def test_a_bias_shifts_what_is_measured(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"drift": {"at": 1.0, "for": 1.0, "bias": {"of": "robot.3.see", "state": [0.0, 0.4]}}}, mode)
    believed, truth = log.series("robot.3", "state"), log.series("robot.3", "world")
    errors = dict(
        zip(believed.times.tolist(), believed.values[:, 1] - truth.values[: len(believed.values), 1], strict=True)
    )
    assert errors[900_000_000] == pytest.approx(0.0)
    assert errors[1_500_000_000] == pytest.approx(0.4)
    assert errors[2_500_000_000] == pytest.approx(0.0)
    assert log.series("robot.2", "state").values[30, 1] == pytest.approx(log.series("robot.2", "world").values[30, 1])


@MODES
def test_noise_is_seeded_by_the_fault_and_the_agent(mode: str, ran: Callable[..., Log]) -> None:
    def errors(faults: Mapping[str, Any], agent: int) -> NDArray[np.float64]:
        log = ran(faults, mode)
        believed, truth = log.series(f"robot.{agent}", "state"), log.series(f"robot.{agent}", "world")
        return believed.values[20:40] - truth.values[20:40]

    noise = {"of": "robot.see", "deviation": [0.1, 0.1]}
    everybody = errors({"burst": {"at": 1.0, "for": 1.0, "noise": noise}}, 1)
    alone = errors({"burst": {"at": 1.0, "for": 1.0, "noise": {**noise, "of": "robot.1.see"}}}, 1)
    other = errors({"storm": {"at": 1.0, "for": 1.0, "noise": noise}}, 1)
    assert 0.05 < np.std(everybody) < 0.2
    assert everybody[0] == pytest.approx(alone[0])
    assert everybody[0] != pytest.approx(other[0])


@MODES
def test_a_slow_component_lands_late(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"busy": {"at": 1.0, "for": 1.0, "slow": {"of": "robot.steer", "latency": 0.2}}}, mode)
    control = log.series("robot.0", "requested_control")
    during = control.times[(control.times > 1.0e9) & (control.times <= 2.0e9)]
    assert during[:2].tolist() == [1_200_000_000, 1_400_000_000]
    assert any(event.name == "overrun" for event in log.events())


@MODES
def test_a_push_changes_the_truth_at_its_time(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"gust": {"at": 1.0, "push": {"of": "robot.1", "by": [0.0, 0.7]}}}, mode)
    series = log.series("robot.1", "world")
    places = dict(zip(series.times.tolist(), series.values[:, 1], strict=True))
    assert places[950_000_000] == pytest.approx(1.0)
    assert places[1_000_000_000] == pytest.approx(1.7)
    assert log.series("robot.0", "world").values[:, 1] == pytest.approx(0.0)


@MODES
def test_a_fault_may_come_with_the_first_event_of_its_kind(mode: str, ran: Callable[..., Log]) -> None:
    log = ran(
        {"crash": {"on": {"event": "goal-reached", "of": "agents.robot.1.*"}, "stop": "robot.0"}}, mode, duration=7.0
    )
    reached = next(event.time for event in log.events() if event.name == "goal-reached" and "robot.1" in event.source)
    (fault,) = [event for event in log.events() if event.name == "fault"]
    assert fault.time == reached + (STEP if mode == "synchronous" else 0)
    assert fault.data == {"fault": "crash"}


@MODES
def test_restarting_a_whole_group_begins_anew(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"again": {"at": 6.5, "restart": "robot.steer"}}, mode, duration=7.0)
    reached = [event.source for event in log.events() if event.name == "goal-reached"]
    # Who is at its goal says so once; after a new beginning, once more.
    assert sorted(reached) == sorted(2 * [f"agents.robot.{row}.steer" for row in range(4)])


def test_faults_may_overlap(ran: Callable[..., Log]) -> None:
    faults = {
        "one": {"at": 1.0, "for": 1.0, "freeze": "robot.0.see"},
        "two": {"at": 1.5, "for": 1.0, "freeze": "robot.see"},
    }
    log = ran(faults)
    believed = log.series("robot.0", "state")
    assert not len(believed.times[(believed.times >= 1.0e9) & (believed.times < 2.5e9)]) or np.ptp(
        believed.values[(believed.times >= 1.0e9) & (believed.times < 2.5e9)], axis=0
    ) == pytest.approx([0.0, 0.0])
    assert believed.times[-1] > 2.5e9


TALK = {"tell": {"use": "communication.state"}, "hear": {"use": "communication.inbox"}}


def stages(log: Log, sender: str) -> list[tuple[int, str, int, str]]:
    """Of all messages of an agent: when each was sent [ns], how it ended, when [ns], and why."""
    sent = {each.id: each.time for each in log.communications() if (each.sender, each.stage) == (sender, "SENT")}
    return [
        (sent[each.id], each.stage, each.time, each.reason)
        for each in log.communications()
        if each.sender == sender and each.stage != "SENT"
    ]


@MODES
@pytest.mark.parametrize("topology", [None, {"use": "complete"}])
def test_dropped_messages_are_those_of_the_link_and_the_time(
    mode: str, topology: dict[str, Any] | None, ran: Callable[..., Log]
) -> None:
    log = ran({"jam": {"at": 1.0, "for": 0.5, "drop": {"sender": "robot.0"}}}, mode, more=TALK, topology=topology)
    during = [each for each in stages(log, "robot.0") if 10**9 <= each[0] < 15 * 10**8]
    before = [each for each in stages(log, "robot.0") if not 10**9 <= each[0] < 15 * 10**8]
    assert len(during) >= 10
    assert {stage for _, stage, _, _ in during} == {"DROPPED"}
    assert {reason for _, _, _, reason in during} == {"jam"}
    assert {stage for _, stage, _, _ in before} == {stage for _, stage, _, _ in stages(log, "robot.1")} == {"DELIVERED"}


@MODES
@pytest.mark.parametrize("topology", [None, {"use": "complete"}])
def test_delayed_messages_come_later_by_what_the_fault_says(
    mode: str, topology: dict[str, Any] | None, ran: Callable[..., Log]
) -> None:
    fault = {"at": 1.0, "for": 0.5, "delay": {"sender": "robot.0", "by": 0.2}}
    log = ran({"slow": fault}, mode, more=TALK, topology=topology)
    usual = {late - sent for sent, _, late, _ in stages(log, "robot.1")}
    during = {late - sent for sent, _, late, _ in stages(log, "robot.0") if 10**9 <= sent < 15 * 10**8}
    assert max(usual) <= STEP
    assert during <= {200_000_000, 200_000_000 + STEP}
    assert {late - sent for sent, _, late, _ in stages(log, "robot.0") if sent < 10**9} == usual


@MODES
@pytest.mark.parametrize(
    ("effect", "concerned"),
    [
        ({"freeze": "robot.2.see"}, [2]),
        ({"freeze": "robot.[13].see"}, [1, 3]),
        ({"freeze": "robot.see"}, [0, 1, 2, 3]),
        ({"blind": "*.see"}, [0, 1, 2, 3]),
        ({"push": {"of": "robot.1", "by": [0.0, 0.1]}}, [1]),
        ({"push": {"of": "robot.[02]", "by": [0.0, 0.1]}}, [0, 2]),
        ({"push": {"of": "robot", "by": [0.0, 0.1]}}, [0, 1, 2, 3]),
        ({"cut": {"between": ["robot.0", "robot.1"]}}, []),
    ],
    ids=str,
)
@pytest.mark.parametrize("of", [None, "agents.*", "see", "exchange"])
def test_a_fault_may_trigger_the_agents_that_it_acts_on(
    effect: dict[str, Any], concerned: list[int], of: str | None, mode: str, ran: Callable[..., Log], doubles: Path
) -> None:
    trigger = {"event": "fault"} if of is None else {"event": "fault", "of": of}
    steer = {"use": "doubles.paper", "trigger": trigger}
    lasts = {} if "push" in effect else {"for": 0.5}
    log = ran({"it": {"at": 1.0, **lasts, **effect}}, mode, more={"react": steer}, recording={"events": "all"})
    turns: set[Any] = set()
    for message in log.messages("/events/recurring"):
        said = message.decode()
        found = zip(said.name, said.source, strict=True)
        turns.update(said.sources[source] for name, source in found if said.names[name] == "computed")
    turns = {each for each in turns if each.endswith(".react")}
    if of == "agents.*":  # whoever's it is, it triggers everybody
        concerned = [0, 1, 2, 3] if concerned else []
    elif of == "see" and "push" in effect:
        concerned = []
    elif of == "exchange":
        concerned = [] if concerned else [0, 1, 2, 3]
    assert turns == {f"agents.robot.{row}.react" for row in concerned}


@MODES
def test_a_component_begins_anew_with_other_parameters_and_later_with_its_own(
    mode: str, ran: Callable[..., Log]
) -> None:
    log = ran({"slower": {"at": 1.0, "for": 0.5, "reconfigure": {"of": "robot.steer", "with": {"speed": 0.4}}}}, mode)
    assert told(log) == [(1.0, "fault", "agents.robot.steer"), (1.5, "fault-over", "agents.robot.steer")]
    moved = np.diff(world(log, 2)[:, 0])
    assert moved[:20] == pytest.approx(0.05)
    assert moved[20:30] == pytest.approx(0.02)
    assert moved[30:] == pytest.approx(0.05)


@MODES
def test_one_agent_has_other_parameters_for_a_while_and_the_others_have_not(mode: str, ran: Callable[..., Log]) -> None:
    log = ran({"slower": {"at": 1.0, "for": 0.5, "reconfigure": {"of": "robot.2.steer", "with": {"speed": 0.4}}}}, mode)
    assert told(log) == [(1.0, "fault", "agents.robot.2.steer"), (1.5, "fault-over", "agents.robot.2.steer")]
    moved = np.diff(world(log, 2)[:, 0])
    assert moved[:20] == pytest.approx(0.05)
    assert moved[20:30] == pytest.approx(0.02)
    assert moved[30:] == pytest.approx(0.05)
    assert np.diff(world(log, 1)[:, 0]) == pytest.approx(0.05)


@MODES
def test_a_state_is_set_and_a_goal_replaced(mode: str, ran: Callable[..., Log]) -> None:
    faults = {
        "back": {"at": 1.0, "place": {"of": "robot.1", "state": [0.0, 7.0]}},
        "home": {"at": 1.0, "inform": {"of": "robot.1", "knowledge": {"goal": [-5.0, 7.0]}}},
    }
    log = ran(faults, mode)
    positions = world(log, 1)
    assert positions[20] == pytest.approx([0.0, 7.0])
    velocity = np.diff(positions, axis=0) / 0.05
    assert velocity[21:] == pytest.approx(np.tile([-1.0, 0.0], (len(velocity) - 21, 1)))
    assert np.diff(world(log, 2)[:, 0]) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"reconfigure": {"of": "robot.steer", "with": {"sped": 1.0}}}, "sped"),
        ({"reconfigure": {"of": "robot.steer", "with": {"speed": -1.0}}}, "speed"),
        ({"reconfigure": {"of": "robot.0.steer", "with": {"sped": 1.0}}}, "sped"),
        ({"reconfigure": {"of": "robot.stear", "with": {"speed": 1.0}}}, "no component `robot.stear`"),
        ({"place": {"of": "robot.0", "state": [1.0]}}, "1 numbers for a state of 2"),
        ({"inform": {"of": "robot", "knowledge": {"gaol": [1.0, 2.0]}}}, "no knowledge `gaol`"),
        ({"inform": {"of": "robot", "knowledge": {"goal": [1.0, 2.0, 3.0]}}}, "of another kind"),
        ({"for": 1.0, "place": {"of": "robot.0", "state": [1.0, 0.0]}}, "it happens at once"),
    ],
)
def test_a_change_that_cannot_be_is_refused_before_the_run(
    change: Mapping[str, Any], said: str, ran: Callable[..., Log]
) -> None:
    with pytest.raises(ScenarioError, match=said):
        ran({"change": {"at": 1.0, **change}})
