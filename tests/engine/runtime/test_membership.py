"""Agents that enter and leave: an absent one neither moves, senses, collides, communicates nor counts."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import Log, open_log
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest

DRIVING = {
    "see": {"use": "perception.range", "with": {"range": 9.0}},
    "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
}


def group(
    present: Any = None,
    *,
    state: Sequence[Any] = (0.0, 0.0),
    goal: Sequence[Any] = (5.0, 0.0),
    components: Mapping[str, Any] = DRIVING,
    radius: float = 0.2,
    **more: Any,
) -> dict[str, Any]:
    content = {
        "entity": {"shape": {"circle": {"radius": radius}}},
        "model": {"use": "single-integrator"},
        "state": list(state),
        "knowledge": {"goal": list(goal)},
        "components": components,
        **more,
    }
    return content if present is None else content | {"present": present}


def scenario(
    tmp_path: Path,
    agents: Mapping[str, Any],
    *,
    world: str = "kinematic",
    duration: float = 3.0,
    entities: Mapping[str, Any] | None = None,
    **more: Any,
) -> Path:
    run = {"duration": duration, **more.pop("run", {})}
    document = {
        "symaware": 1,
        "name": "open",
        "seed": 3,
        "run": run,
        "environment": {"use": world, "with": {"time_step": 0.1}, "entities": entities or {}},
        "agents": agents,
        **more,
    }
    path = tmp_path / "open.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def recorded(tmp_path: Path, agents: Mapping[str, Any], name: str = "open", **options: Any) -> tuple[RunSummary, Log]:
    path = scenario(tmp_path, agents, **options)
    summary = execute(build(path), tmp_path / f"{name}.mcap")
    assert summary.status == "finished", summary.failure
    return summary, open_log(tmp_path / f"{name}.mcap")


def told(log: Log, *names: str) -> list[tuple[str, str, float]]:
    return [(each.name, each.source, each.time / 1e9) for each in log.events() if each.name in names]


WORLDS = ("kinematic", "pymunk", "pybullet")


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_an_agent_enters_at_a_time_in_its_initial_state_and_leaves_on_a_condition_about_itself(
    tmp_path: Path, mode: str
) -> None:
    agents = {"car": group({"from": 1.0, "until": "position[0] > 0.95"})}
    _, log = recorded(tmp_path, agents, run={"mode": mode})
    assert told(log, "added", "removed") == [("added", "agents.car", 1.0), ("removed", "agents.car", 2.1)]
    assert log.presence == {"car": ((1_000_000_000, 2_100_000_000),)}
    truth = log.series("car", "world")
    assert truth.seconds[0] == 1.0
    assert truth.values[0].tolist() == [0.0, 0.0]
    assert truth.values[-2, 0] == pytest.approx(1.0)
    assert np.isnan(truth.values[-1]).all()


def test_that_somebody_is_about_to_enter_or_leave_is_announced_before_it_is_so(tmp_path: Path) -> None:
    built = build(scenario(tmp_path, {"car": group({"from": 1.0, "until": 2.0})}))
    (car,), seen = built.simulation.groups, []
    for name in ("adding", "added", "removing", "removed"):
        built.simulation.events.subscribe(name, lambda event: seen.append((event.name, event.source, len(car.rows))))
    run(built.simulation, built.steps, options=built.options)
    assert seen == [
        ("adding", "agents.car", 0),
        ("added", "agents.car", 1),
        ("removing", "agents.car", 1),
        ("removed", "agents.car", 0),
    ]


def test_agents_enter_and_leave_with_events_of_others_and_of_their_own(tmp_path: Path) -> None:
    agents = {
        "first": group({"until": {"event": "goal-reached"}}, goal=(0.5, 0.0)),
        "second": group({"from": {"event": "removed", "of": "agents.first"}}, state=(0.0, 3.0)),
    }
    _, log = recorded(tmp_path, agents)
    (reached, removed, added) = told(log, "goal-reached", "removed", "added")[:3]
    assert [each[:2] for each in (removed, added)] == [("removed", "agents.first"), ("added", "agents.second")]
    assert reached[2] < removed[2] < added[2]


def test_a_condition_on_which_somebody_enters_is_about_the_world(tmp_path: Path) -> None:
    agents = {"a": group(), "b": group({"from": 'position["a"][0] > 0.45'}, state=(0.0, 3.0))}
    _, log = recorded(tmp_path, agents)
    assert told(log, "added") == [("added", "agents.b", 0.5)]


def test_agents_of_a_group_have_own_times_and_messages_have_the_present_ones(tmp_path: Path) -> None:
    present = [{}, {"from": 1.0}, {"from": 1.0, "until": 2.0}]
    agents = {"car": group(present, state=[[0.0, 0.0], [0.0, 2.0], [0.0, 4.0]], count=3)}
    _, log = recorded(tmp_path, agents)
    rows = {message.time / 1e9: message.decode().rows for message in log.messages("/world/car/state")}
    assert rows[0.9].tolist() == [0]
    assert rows[1.0] is None
    assert rows[2.0].tolist() == [0, 1]
    values = log.series("car", "world")
    there = np.isfinite(values.values[:, :, 0])
    assert there[values.seconds == 0.5].tolist() == [[True, False, False]]
    assert there[values.seconds == 1.5].tolist() == [[True, True, True]]
    assert there[values.seconds == 2.5].tolist() == [[True, True, False]]


@pytest.mark.parametrize("world", WORLDS)
def test_an_absent_agent_changes_not_one_bit_for_others(tmp_path: Path, world: str) -> None:
    components = {
        "see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.05, "self_noise": 0.02}},
        "scan": {"use": "perception.lidar", "with": {"rays": 8, "noise": 0.01}},
        "believe": {"use": "uncertainty.gaussian"},
        "fear": {"use": "risk.time-to-collision"},
        "tell": {"use": "communication.state"},
        "hear": {"use": "communication.inbox"},
        "steer": {"use": "control.velocity-obstacle", "with": {"speed": 1.0}},
    }
    present = {
        "car": group(state=[[0.0, 0.0], [4.0, 0.3]], goal=[[4.0, 0.0], [0.0, 0.3]], count=2, components=components),
    }
    absent = {"zebra": group({"from": 50.0}, state=(2.0, 0.0), goal=(2.0, 4.0), components=components)}
    for name, agents in (("without", present), ("with", present | absent)):
        recorded(tmp_path, agents, name, world=world)
    said = [contents(open_log(tmp_path / f"{name}.mcap")) for name in ("without", "with")]
    assert said[0].keys() <= said[1].keys()
    assert all("zebra" in topic for topic in said[1].keys() - said[0].keys())
    for topic, messages in said[0].items():
        assert messages == said[1][topic], topic


def contents(log: Log) -> dict[str, list[tuple[int, bytes]]]:
    """What was said on each channel, and when; the first event says how many agents there are."""
    topics = [topic for topic in log.channels if topic not in ("/timing", "/events")]
    return {topic: [(each.time, each.data) for each in log.messages(topic)] for topic in topics}


@pytest.mark.parametrize("world", WORLDS)
def test_a_contact_ends_when_one_of_the_two_leaves(tmp_path: Path, world: str) -> None:
    agents = {
        "one": group(state=(0.0, 0.0), components={}),
        "other": group({"until": 1.0}, state=(0.3, 0.0), components={}),
    }
    _, log = recorded(tmp_path, agents, world=world)
    began, *_, ended = [each for each in log.contacts() if {each.a, each.b} == {"one", "other"}]
    assert (began.stage, ended.stage) == ("BEGIN", "END")
    assert 1_000_000_000 <= ended.time <= 1_100_000_000


def test_a_message_to_an_agent_that_has_left_is_dropped_as_absent(tmp_path: Path) -> None:
    talk = {"tell": {"use": "communication.state"}, "hear": {"use": "communication.inbox"}}
    components = {"see": {"use": "perception.self"}, **talk}
    agents = {
        "one": group(components=components),
        "other": group({"until": 1.0}, state=(0.0, 3.0), components=components),
    }
    _, log = recorded(tmp_path, agents, topology={"use": "complete", "channel": {"delay": 0.25}})
    absent = [each for each in log.communications() if each.reason == "absent"]
    assert absent
    assert {(each.sender, each.receiver) for each in absent} == {("one", "other")}
    # What was sent at 0.7 s arrives at 0.95 s, and would be read with the step at which the other leaves.
    assert [each.sent_time for each in absent] == [700_000_000, 800_000_000, 900_000_000]


def test_the_order_of_groups_in_the_file_changes_no_byte_where_they_enter_and_leave(tmp_path: Path) -> None:
    agents = {
        "first": group({"until": 1.5}),
        "second": group({"from": 0.5, "until": 1.5}, state=(5.0, 0.1), goal=(0.0, 0.0)),
        "third": group({"from": {"event": "removed", "of": "agents.first"}}, state=(2.0, 3.0)),
    }
    for name, order in (("forth", agents), ("back", dict(reversed(agents.items())))):
        recorded(tmp_path, order, name)
    forth, back = (digest(open_log(tmp_path / f"{name}.mcap")).channels for name in ("forth", "back"))
    assert forth == back


BREAK = {"until": 1.0, "again": [{"from": 2.0, "until": "position[0] > 1.45"}, {"from": 2.8}]}


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_an_agent_returns_in_the_state_in_which_it_left(tmp_path: Path, mode: str) -> None:
    summary, log = recorded(tmp_path, {"car": group(BREAK)}, run={"mode": mode}, duration=4.0)
    assert summary.agents == 1
    assert log.presence == {
        "car": ((0, 1_000_000_000), (2_000_000_000, 2_600_000_000), (2_800_000_000, None)),
    }
    truth = log.series("car", "world")
    states = dict(zip(truth.seconds.tolist(), truth.values[:, 0].tolist(), strict=True))
    assert states[0.9] == pytest.approx(0.9)
    assert np.isnan(states[1.0])
    assert states[2.0] == pytest.approx(1.0)
    assert states[2.8] == pytest.approx(1.6)
    assert states[4.0] == pytest.approx(2.8)


def test_a_return_on_an_event_awaits_one_that_fires_during_the_absence(tmp_path: Path) -> None:
    first = group({"until": 0.5, "again": [{"from": 1.5}]})
    second = group(
        {"until": 0.2, "again": [{"from": {"event": "added", "of": "agents.first"}}]}, state=[0.0, 3.0], goal=[5.0, 3.0]
    )
    _, log = recorded(tmp_path, {"first": first, "second": second})
    assert log.presence["second"] == ((0, 200_000_000), (1_600_000_000, None))


def test_an_absent_agent_has_no_effect_on_others(tmp_path: Path) -> None:
    other = group(state=[0.0, 1.0], goal=[5.0, 1.0])
    components = {"see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.1}}}
    watcher = other | {"components": components}
    _, one = recorded(tmp_path, {"watcher": watcher, "car": group(BREAK)}, "one")
    _, two = recorded(tmp_path, {"watcher": watcher, "car": group({"until": 1.0})}, "two")
    for start, end, equal in ((0, 2_000_000_000, True), (2_000_000_000, None, False)):
        first, second = (
            [each.data for each in log.messages("/agents/watcher/awareness", start, end)] for log in (one, two)
        )
        assert (first == second) is equal


def test_each_stay_of_an_agent_is_evaluated_and_the_worst_counts(tmp_path: Path) -> None:
    formulas = {"early": "always position[0] < 0.95", "late": "always position[0] < 1.2", "all": "always time < 9"}
    specifications = {name: {"each": "car", "formula": formula} for name, formula in formulas.items()}
    summary, _ = recorded(tmp_path, {"car": group(BREAK)}, specifications=specifications)
    found = {each.name: each.verdict for each in summary.specifications}
    assert found == {"early": "violated", "late": "violated", "all": "satisfied"}
    without, _ = recorded(tmp_path, {"car": group({"until": 1.0})}, specifications=specifications)
    assert {each.name: each.verdict for each in without.specifications}["late"] == "satisfied"


def test_agents_that_return_later_have_yet_to_reach_their_goals(tmp_path: Path) -> None:
    back = {"until": 0.5, "again": [{"from": 1.0, "until": 1.2}]}
    agents = {"car": group(back), "other": group(state=[4.99, 1.0], goal=[5.0, 1.0])}
    summary, _ = recorded(tmp_path, agents, run={"until": "all(goals_reached)"})
    assert summary.simulated_time == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("present", "said"),
    [
        ({"again": [{"from": 1.0}]}, "an agent that returns has to leave before: `until` is missing"),
        ({"until": 1.0, "again": [{"until": 2.0}]}, "`from` is missing: when it returns"),
        ({"until": 1.0, "again": [{"from": 1.0}]}, "an agent that leaves at 1 s cannot return at 1 s"),
        ({"until": 1.0, "again": [{"from": 2.0, "until": 1.5}]}, "an agent that leaves at 1.5 s has not entered by"),
    ],
)
def test_returns_that_contradict_each_other_are_refused(tmp_path: Path, present: Any, said: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(said)):
        build(scenario(tmp_path, {"car": group(present)}))


def test_worlds_of_physics_engines_refuse_agents_that_return(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="the world `pymunk` does not support agents that return"):
        build(scenario(tmp_path, {"car": group(BREAK)}, world="pymunk"))
