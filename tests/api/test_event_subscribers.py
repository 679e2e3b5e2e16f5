"""Functions that are called at events: of a run, of a simulation, and of a scenario."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import symaware_doubles
import yaml
from simulating import Command, untyped

import symaware_cli as sa
from symaware_cli.core import Component, Contact, Event, GroupComponent, Message
from symaware_cli.log.digest import digest

DOCUMENT: Mapping[str, Any] = {
    "symaware": 1,
    "name": "told",
    "run": {"duration": 0.3},
    "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
    "agents": {
        "robot": {
            "count": 2,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "single-integrator"},
            "state": [[0.0, 0.0], [0.65, 0.0]],
            "knowledge": {"goal": [0.3, 0.0]},
            "present": [{}, {"until": 0.25}],
            "components": {
                "inbox": {"use": "communication.inbox"},
                "see": {"use": "perception.omniscient"},
                "steer": {"use": "control.go-to-goal"},
                "tell": {"use": "communication.broadcast"},
            },
        }
    },
    "topology": {"use": "complete", "channel": {"loss": 0.4}},
}

#: Each event that recurs, and whether it has an agent, a component and a value.
RECURRING = {
    "initialising": ("group", "component", None),
    "initialised": ("group", "component", None),
    "iterating": (None, None, None),
    "iterated": (None, None, None),
    "computing": ("either", "component", None),
    "computed": ("either", "component", "any"),
    "updating": ("either", "component", "any"),
    "updated": ("either", "component", "any"),
    "stepping": (None, None, None),
    "stepped": (None, None, None),
    "sending": ("agent", None, Message),
    "sent": ("agent", None, Message),
    "received": ("agent", None, Message),
    "dropped": ("agent", None, Message),
    "removing": ("agent", None, None),
}


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return written(tmp_path, {})


def written(folder: Path, more: Mapping[str, Any]) -> Path:
    path = folder / "told.yaml"
    path.write_text(yaml.safe_dump({**DOCUMENT, **more}, sort_keys=False))
    return path


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_every_event_is_given_with_its_agent_component_and_value(path: Path, mode: Any) -> None:
    events: list[Event] = []
    sa.load(path).run(record=False, mode=mode, on_event=events.append)
    by_name: dict[str, list[Event]] = {}
    for event in events:
        by_name.setdefault(event.name, []).append(event)
    assert {*by_name} >= {*RECURRING, "started", "contact", "removed", "finished"}
    assert "traffic" not in by_name
    for name, (agent, component, value) in RECURRING.items():
        for event in by_name[name]:
            if agent in (None, "group"):
                assert event.agent is None
            elif agent == "agent":
                assert event.agent in ("robot.0", "robot.1")
            else:
                assert event.agent == getattr(getattr(event.subject, "agent", None), "id", None)
            assert event.component in ((None,) if component is None else ("inbox", "see", "steer", "tell"))
            if value is None:
                assert event.value is None
            elif not isinstance(value, str):
                assert isinstance(event.value, value)
            if isinstance(event.subject, Component | GroupComponent):
                assert event.component == event.subject.name
    assert all(isinstance(event.value, Contact) for event in by_name["contact"])
    steered = [event for event in by_name["computed"] if event.component == "steer"]
    assert [event.seconds for event in steered] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2, 0.25])
    assert all(event.value is not None for event in steered)


POSTS: Mapping[str, Any] = {
    "communication.state": {},
    "communication.broadcast": {},
    "communication.request": {"with": {"whom": ["robot.*"], "names": ["goal"]}},
    "communication.consensus": {"with": {"name": "goal", "gain": 0.5}},
    "communication.gossip": {"with": {"name": "goal"}},
    "communication.flooding": {"with": {"names": ["goal"]}},
}


@pytest.mark.parametrize("use", POSTS)
def test_messages_of_agents_and_of_whole_groups_are_announced_before_they_are_sent(use: str, path: Path) -> None:
    events: list[Event] = []
    agents = yaml.safe_load(path.read_text())["agents"]
    agents["robot"]["components"] = {"see": {"use": "perception.omniscient"}, "tell": {"use": use, **POSTS[use]}}
    scenario = sa.load(written(path.parent, {"agents": agents, "topology": {"use": "complete"}}))
    scenario.run(record=False, on_event={"sending": events.append, "sent": events.append})
    sending, sent = ([event for event in events if event.name == name] for name in ("sending", "sent"))
    assert sending
    assert {event.agent for event in sending} == {"robot.0", "robot.1"}
    # Of two agents, each reaches the other, as long as both are there.
    both = [event for event in sending if event.seconds < 0.25]
    assert len(both) == len([event for event in sent if event.seconds < 0.25])
    for one, other in zip(both, sent, strict=False):
        assert (one.agent, one.value.kind, [*one.value.payload]) == (
            other.agent,
            other.value.kind,
            [*other.value.payload],
        )


def test_a_run_is_the_same_with_and_without_subscribers(path: Path) -> None:
    scenario = sa.load(path)
    scenario.run(output="without.mcap")
    scenario.run(output="with.mcap", on_event=lambda event: None)
    assert not digest(sa.open_log("with.mcap")).differences(digest(sa.open_log("without.mcap")))


def test_a_simulation_calls_a_function_at_events_that_match_until_it_is_cancelled(path: Path) -> None:
    told: list[str] = []
    with sa.load(path).start() as simulation:
        subscription = simulation.subscribe(
            "comput*", lambda event: told.append(f"{event.name} {event.source}"), "*steer"
        )
        simulation.step()
        assert told == ["computing agents.robot.steer", "computed agents.robot.steer"]
        subscription.cancel()
        simulation.step()
        assert len(told) == 2
        simulation.subscribe("removed", lambda event: told.append(event.name))
        simulation.finish()
    assert told[2:] == ["removed"]


def test_functions_by_names_are_called_for_those_alone(path: Path) -> None:
    told: list[Event] = []
    wanted: list[frozenset[str]] = []

    def keep(event: Event) -> None:
        told.append(event)

    with sa.load(path).start(on_event={"contact": keep, "step*": keep}) as simulation:
        wanted.append(untyped(simulation)._simulation.events.wanted)
        simulation.finish()
    assert {event.name for event in told} == {"contact", "stepping", "stepped"}
    assert "computed" not in wanted[0]


def test_a_scenario_names_the_function_of_a_plugin(doubles: Path, path: Path) -> None:
    symaware_doubles.WATCHED.clear()
    subscribers = {"watch": {"use": "doubles.watch", "event": "updated", "of": "agents.robot.steer"}}
    scenario = sa.load(written(path.parent, {"subscribers": subscribers}))
    scenario.run(record=False)
    assert symaware_doubles.WATCHED == [("updated", "agents.robot.steer")] * 6
    assert scenario.validate().digest != sa.load(written(path.parent, {})).validate().digest


def test_a_subscriber_that_is_not_there_is_reported_with_its_place(doubles: Path, path: Path) -> None:
    with pytest.raises(sa.ScenarioError) as caught:
        sa.load(written(path.parent, {"subscribers": {"watch": {"use": "doubles.wach"}}}))
    (problem,) = caught.value.problems
    assert (problem.code, problem.path, problem.suggestion) == (
        "unknown-plugin",
        "subscribers.watch.use",
        "doubles.watch",
    )


def test_a_subscriber_that_raises_fails_the_run(doubles: Path, path: Path) -> None:
    scenario = sa.load(written(path.parent, {"subscribers": {"watch": {"use": "doubles.refuse", "event": "stepped"}}}))
    with pytest.raises(sa.RunFailedError, match="subscriber refuse of event stepped of environment raised"):
        scenario.run(record=False)


def test_the_commands_show_a_subscriber(doubles: Path, command: Command) -> None:
    assert "doubles.watch" in command("list", "subscribers").stdout
    assert "Keeps the events" in command("show", "doubles.watch").stdout


def test_a_branch_begins_at_an_event(path: Path) -> None:
    events: list[Event] = []
    scenario = sa.load(path)
    run = scenario.run(output="run.mcap", on_event={"contact": events.append})
    (logged,) = [event for event in run.log.events() if event.name == "removed"]
    for event in (events[0], logged):
        made = sa.branch("run.mcap", event, {"agents.robot.components.steer.with.speed": 0.2}, "branch.mcap")
        assert made.at == event.seconds
