"""Equal scenarios have equal logs, and an agent does not depend on unrelated ones."""

import json
import re
import shutil
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import Log, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import digest
from symaware_cli.log.reader import LogMessage
from symaware_cli.testing import assert_repeatable

Found = dict[tuple[str, str], list[Any]]

SCENARIOS = sorted(
    path
    for path in (Path(__file__).parent.parent / "scenarios").rglob("*")
    if path.suffix in (".yaml", ".yml", ".toml") and re.search(r"^symaware\b", path.read_text(), re.MULTILINE)
)

#: One scenario for each mode, world and source of order; .ci/scenarios.py compares whole runs of all of them.
KINDS_OF_RUN = ("asynchronous", "fog", "hello", "mpc", "rumour", "three-worlds", "two-doors")


@pytest.mark.parametrize("name", KINDS_OF_RUN)
def test_an_example_repeats_itself_byte_for_byte_in_another_process(name: str, scenarios: Path) -> None:
    scenario = scenarios / f"{name}.yaml"
    duration = min(2.0, build(scenario).document.run.duration)
    result = assert_repeatable(scenario, [f"run.duration={duration}"], timeout=120)
    assert any(topic.startswith("/world/") for topic in result.channels)
    assert "/timing" not in result.channels


def test_another_seed_is_another_run(tmp_path: Path) -> None:
    scenario = write(tmp_path / "crowd.yaml", CROWD)
    short = ["run.duration=0.5"]
    assert assert_repeatable(scenario, short, seed=1).combined != assert_repeatable(scenario, short, seed=2).combined


def test_a_run_that_does_not_finish_proves_no_repeatability(tmp_path: Path, doubles: Path) -> None:
    crowd = crowd_with(fault={"use": "doubles.fault"})
    with pytest.raises(AssertionError, match=r"exited with 1: .*doubles.fault"):
        assert_repeatable(write(tmp_path / "fault.yaml", crowd))
    with pytest.raises(AssertionError, match=r"exited with 2: "):
        assert_repeatable(tmp_path / "missing.yaml")


# A set of strings is ordered by their hashes; an address is where the object happens to lie.
@pytest.mark.parametrize("source", ["address", "set", "time", "random", "numpy", "processor"])
def test_a_plugin_that_depends_on_chance_is_found_out_and_located(source: str, tmp_path: Path, doubles: Path) -> None:
    crowd = crowd_with(chance={"use": "doubles.chance", "with": {"source": source}})
    with pytest.raises(AssertionError) as caught:
        assert_repeatable(write(tmp_path / "chance.yaml", crowd), ["run.duration=0.4"])
    said = str(caught.value)
    assert "chance.yaml differ in /agents/robot/risk;" in said
    # It behaves until 0.2 s; the next step is at 0.25 s.
    assert "the first difference is at 0.25 s on /agents/robot/risk, robot.0 risk[0]: " in said


def test_the_same_plugin_passes_without_a_random_dependency(tmp_path: Path, doubles: Path) -> None:
    crowd = crowd_with(chance={"use": "doubles.chance", "with": {"source": "nothing"}})
    assert_repeatable(write(tmp_path / "chance.yaml", crowd), ["run.duration=0.5"])


ROBOT: dict[str, Any] = {
    "count": 5,
    "entity": {"shape": {"circle": {"radius": 0.3}}},
    "model": {"use": "unicycle", "with": {"max_speed": 1.5}},
    "state": {"uniform": [[-5, -5, -3], [5, 5, 3]]},
    "knowledge": {"goal": {"normal": [[0, 0], 4]}, "home": {"all": ["a", "b"]}},
    "components": {"sense": {"use": "perception.omniscient"}, "steer": {"use": "control.go-to-goal"}},
}
CAR: dict[str, Any] = {
    "model": {"use": "single-integrator", "with": {"max_speed": 2.0}},
    "state": [{"uniform": [-1, 1]}, 3.0],
    "knowledge": {"goal": [3, -3]},
    "components": {"sense": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
}
FAR: dict[str, Any] = {
    "count": 3,
    "model": {"use": "single-integrator"},
    "state": {"normal": [[1000, 1000], 1]},
    "knowledge": {"goal": {"all": [1000, 1000]}},
    "components": {"sense": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
}
CROWD: dict[str, Any] = {
    "symaware": 1,
    "name": "crowd",
    "seed": 11,
    "run": {"duration": 2.0},
    "environment": {"use": "kinematic"},
    "agents": {"robot": ROBOT, "car": CAR},
}


def write(path: Path, document: Mapping[str, Any]) -> Path:
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def crowd_with(**components: Any) -> dict[str, Any]:
    return CROWD | {"agents": {"robot": ROBOT | {"components": ROBOT["components"] | components}}}


@pytest.fixture
def recorded(tmp_path: Path) -> Callable[..., Found]:
    """Run a document and return all recorded data of each agent, by id, as bytes that can be compared."""

    def run(document: Mapping[str, Any], name: str = "run") -> Found:
        summary = execute(build(write(tmp_path / f"{name}.yaml", document)), tmp_path / f"{name}.mcap")
        assert summary.status == "finished"
        return by_agent(open_log(tmp_path / f"{name}.mcap"))

    return run


def by_agent(log: Log) -> Found:
    """For each agent and kind of data, all of its records, in order."""
    found: dict[Any, Any] = {}
    roster = log.manifest["roster"]
    for group, content in log.manifest["groups"].items():
        ids = content["agents"]
        for topic in (f"/world/{group}/state", *(f"/agents/{group}/{kind}" for kind in KINDS)):
            kind = topic.split("/")[1] + "/" + topic.split("/")[3]
            for message in log.messages(topic):
                for id, value in rows(message, ids, roster):
                    found.setdefault((id, kind), []).append((message.time, value))
    for event in log.events():
        if event.source.startswith("agents."):
            id, _, component = event.source.removeprefix("agents.").rpartition(".")
            said = (event.time, (event.name, event.text, json.dumps(event.data)))
            found.setdefault((id, f"events/{component}"), []).append(said)
    return found


KINDS = ("state", "intent", "uncertainty", "risk", "control", "awareness", "knowledge")


def rows(message: LogMessage, ids: Sequence[str], roster: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """The content of a message about each agent."""
    content = message.decode()
    kind = message.channel.schema.rpartition(".")[2]
    numbers = [int(row) for row in content.rows] if content.rows is not None else []
    chosen = [ids[row] for row in numbers] or ids
    if kind == "Rows":
        yield from ((id, value.tobytes()) for id, value in zip(chosen, content.values, strict=True))
    elif kind == "SeriesRows":
        for id, (times, values) in zip(chosen, content, strict=True):
            yield id, (times.tobytes(), values.tobytes())
    elif kind == "Knowledge":
        yield from ((id, value) for id, value in zip(chosen, content.values, strict=True))
    elif content.world:
        yield from ((id, "whole world") for id in chosen)
    else:
        start, place = 0, 0
        lengths = np.broadcast_to(content.lengths, len(chosen)) if len(content.lengths) == 1 else content.lengths
        sizes = content.columns
        for id, length in zip(chosen, lengths, strict=True):
            known = []
            for number in range(start, start + int(length)):
                size = int(sizes[number] if len(sizes) > 1 else sizes[0])
                known.append((roster[content.entities[number]], content.values[place : place + size].tobytes()))
                place += size
            start += int(length)
            yield id, tuple(known)


def test_the_order_of_agents_in_the_file_changes_nothing_about_any_of_them(
    recorded: Callable[..., Found],
) -> None:
    document = CROWD | {"agents": {"robot": ROBOT, "car": CAR, "far": FAR}}
    plain = recorded(document)
    turned = recorded(document | {"agents": {"far": FAR, "car": CAR, "robot": ROBOT}}, "turned")
    assert plain == turned
    agents = {id for id, _ in plain}
    assert agents == {"car", *(f"robot.{row}" for row in range(5)), *(f"far.{row}" for row in range(3))}
    assert {kind for _, kind in plain} >= {"world/state", "agents/state", "agents/intent", "agents/control"}


def _of_several_groups() -> Iterator[Any]:
    for path in SCENARIOS:
        content = path.read_text()
        document = tomllib.loads(content) if path.suffix == ".toml" else yaml.safe_load(content)
        if len(document.get("agents", {})) > 1:
            yield path


@pytest.mark.parametrize("scenario", list(_of_several_groups()), ids=lambda path: path.name)
def test_the_order_of_groups_in_the_file_changes_no_byte_of_the_log(scenario: Path, tmp_path: Path) -> None:
    """All channels are compared, the events and messages that the groups share among them."""
    folder = tmp_path / "scenarios"
    shutil.copytree(scenario.parent, folder)
    document = yaml.safe_load(build(scenario).resolved)
    document["run"]["duration"] = min(document["run"]["duration"], 4.0)
    groups, digests = list(document["agents"]), set()
    for number, order in enumerate([groups, groups[::-1], groups[1:] + groups[:1]]):
        document["agents"] = {name: document["agents"][name] for name in order}
        path = folder / f"order-{number}.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        log = tmp_path / f"{number}.mcap"
        assert execute(build(path), log).status == "finished"
        digests.add(tuple(digest(open_log(log)).channels.items()))
    assert len(digests) == 1


def test_the_order_of_keys_in_the_file_changes_nothing_about_any_agent(
    recorded: Callable[..., Found],
) -> None:
    turned = {
        key: value if key == "components" else dict(reversed(value.items())) if isinstance(value, dict) else value
        for key, value in reversed(ROBOT.items())
    }
    assert recorded(CROWD) == recorded(CROWD | {"agents": {"robot": turned, "car": CAR}}, "turned")


def test_the_order_of_components_that_do_not_read_each_other_changes_nothing_else(
    recorded: Callable[..., Found],
) -> None:
    components = {"stray": {"use": "perception.self"}, **CAR["components"]}
    turned = {**CAR["components"], "stray": {"use": "perception.self"}}
    one = recorded(CROWD | {"agents": {"car": CAR | {"components": components}}})
    other = recorded(CROWD | {"agents": {"car": CAR | {"components": turned}}}, "turned")
    assert one == other


def others_of(found: Found, ids: Collection[str]) -> Found:
    """The records of some agents only."""
    return {key: value for key, value in found.items() if key[0] in ids}


@pytest.mark.parametrize("name", ["aaa", "zzz"])
def test_a_group_far_away_changes_nothing_about_the_others(name: str, recorded: Callable[..., Found]) -> None:
    alone = recorded(CROWD)
    together = recorded(CROWD | {"agents": {name: FAR, **CROWD["agents"]}}, "together")
    assert others_of(together, {id for id, _ in alone}) == alone
    assert any(id.startswith(name) for id, _ in together)


@pytest.mark.parametrize("count", [6, 11, 70])
def test_more_agents_of_a_group_do_not_change_the_others(count: int, recorded: Callable[..., Found]) -> None:
    few = recorded(CROWD)
    many = recorded(CROWD | {"agents": {"robot": ROBOT | {"count": count}, "car": CAR}}, "many")
    assert others_of(many, {id for id, _ in few}) == few
    assert len({id for id, _ in many if id.startswith("robot")}) == count


def test_earlier_runs_in_a_process_do_not_change_a_run(tmp_path: Path) -> None:
    scenario = write(tmp_path / "crowd.yaml", CROWD)
    results = set()
    for number in range(3):
        np.random.rand(number)  # noqa: NPY002 (the global state must not matter)
        log = tmp_path / f"{number}.mcap"
        execute(build(scenario), log)
        results.add(digest(open_log(log)).combined)
    assert len(results) == 1


@pytest.mark.parametrize(("name", "count"), [("aaa", 3), ("zzz", 80)])
def test_distant_agents_do_not_change_perception_estimation_and_avoidance(
    name: str, count: int, tmp_path: Path
) -> None:
    """With eighty more, neighbours are found by a tree and no longer by looking at all pairs."""
    document = yaml.safe_load((Path(__file__).parents[1] / "scenarios" / "crossing.yaml").read_text())
    document["run"]["duration"] = 13.0
    logs: list[Any] = []
    far = {**document["agents"]["robot"], "count": count, "state": [[5000.0, 4.0 * row, 0.0] for row in range(count)]}
    far["knowledge"] = {"goal": [[5020.0, 4.0 * row] for row in range(count)]}
    for agents in (document["agents"], {name: far, **document["agents"]}):
        path = tmp_path / f"{len(logs)}.yaml"
        path.write_text(yaml.safe_dump({**document, "agents": agents}, sort_keys=False))
        execute(build(path), path.with_suffix(".mcap"))
        logs.append(open_log(path.with_suffix(".mcap")))
    for field in ("world", "state", "applied_control", "intent", "uncertainty", "risk"):
        alone, among = (log.series("robot", field) for log in logs)
        assert alone.times.tolist() == among.times.tolist()
        assert alone.values.tobytes() == among.values.tobytes(), field
    assert logs[0].series("robot", "risk").values.max() > 0.5, "nothing happened that could have differed"
