"""The parts of a run that several processes shared become one log, which says what that of a single process says."""

import json
import random
import re
import shutil
import tempfile
import tracemalloc
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import reduce
from itertools import permutations
from operator import or_
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import CSV, export_tables
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from parts import contents, split, write_part
from sample_log import MANIFEST, STEP, write_sample
from simulating import present, untyped

from fuzzing.log_verbs import called
from symaware_cli import Log
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.log.digest import digest
from symaware_cli.log.error import LogError, OutputError
from symaware_cli.log.index import FRAME
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter
from symaware_cli.processes.merging import merge
from symaware_cli.processes.process_log import open_process_logs


def joined(paths: Sequence[Path], path: Path) -> Log:
    """Merge, and see to what holds of every log: it is sound, numbered and in order."""
    merged = merge(open_process_logs(paths), path)
    log = open_log(path)
    assert log.verify() is None
    messages = list(log.messages())
    assert (merged.messages, merged.size) == (len(messages), path.stat().st_size)
    assert (merged.start_time, merged.end_time) == (log.start_time, log.end_time)
    for timing in (False, True):
        numbers = [each.sequence for each in messages if (each.channel.topic == "/timing") == timing]
        assert numbers == list(range(len(numbers)))
    assert [each.time for each in messages] == sorted(each.time for each in messages)
    return log


def messages(log: Log, topic: str) -> list[tuple[int, bytes]]:
    return [(each.time, each.data) for each in log.messages(topic)]


SENSING = """\
symaware: 1
name: sensing
environment:
  use: kinematic
  entities: {wall: {shape: {box: {length: 1, width: 8}}, position: [3, 0]}}
agents:
  robot:
    count: 4
    model: {use: unicycle}
    state: {circle: {radius: 5.0}}
    knowledge: {goal: {circle: {radius: 5.0, phase: 3.14159}}}
    components:
      sense: {use: perception.omniscient}
      scan: {use: perception.lidar, with: {rays: 32}}
      feel: {use: perception.imu}
      steer: {use: control.go-to-goal, with: {speed: 1.2}}
"""


def recorded(scenario: Path, folder: Path) -> Path:
    """The log of the first three seconds of a run."""
    log = folder / f"{scenario.stem}.mcap"
    status, _, trouble = called(["run", scenario, "--set", "run.duration=3", "--quiet", "--output", log])
    assert status == 0, trouble
    return log


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory, scenarios: Path) -> Path:
    """Twelve robots that perceive, believe, fear and plan, in one group."""
    return recorded(scenarios / "crossing.yaml", tmp_path_factory.mktemp("crossing"))


@pytest.fixture(scope="module")
def convoy(tmp_path_factory: pytest.TempPathFactory, scenarios: Path) -> Path:
    """Groups that talk to each other over a network."""
    return recorded(scenarios / "convoy.yaml", tmp_path_factory.mktemp("convoy"))


@pytest.fixture(scope="module")
def sensing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robots with a lidar and an inertial measurement unit, who know the whole world."""
    folder = tmp_path_factory.mktemp("sensing")
    folder.joinpath("sensing.yaml").write_text(SENSING)
    return recorded(folder / "sensing.yaml", folder)


@pytest.fixture
def parts(sample: Path, tmp_path: Path) -> list[Path]:
    """Of the sample, the car and a robot elsewhere."""
    return split(sample, tmp_path, {"left": ["robot.1"], "right": ["car"]})


def whole_and_merged(path: Path, folder: Path, shares: Mapping[str, Sequence[str]]) -> tuple[Log, Log]:
    whole, log = open_log(path), joined(split(path, folder, shares), folder / "whole.mcap")
    assert contents(log) == contents(whole)
    return whole, log


def test_a_group_that_was_split_reads_like_that_of_one_process(crossing: Path, tmp_path: Path) -> None:
    shares = {"west": ["robot.0", "robot.1", "robot.2"], "odd": ["robot.5", "robot.11"]}
    whole, log = whole_and_merged(crossing, tmp_path, shares)
    assert log.agents == whole.agents
    assert log.outcome == whole.outcome
    for field in ("state", "world", "applied_control", "intent", "uncertainty", "risk"):
        for name in ("robot", "robot.1", "robot.7", "robot.11"):
            expected, found = whole.series(name, field), log.series(name, field)
            np.testing.assert_array_equal(found.times, expected.times)
            np.testing.assert_array_equal(found.values, expected.values)
            assert (found.columns, found.units) == (expected.columns, expected.units)
    for agent, other in (("robot.1", "robot.5"), ("robot.5", "robot.1"), ("robot.7", "robot.0")):
        expected, found = whole.beliefs(agent, other), log.beliefs(agent, other)
        np.testing.assert_array_equal(found.values, expected.values)
        np.testing.assert_array_equal(found.covariances, expected.covariances)
    assert list(log.events()) == list(whole.events())


@pytest.mark.parametrize("name", ["crossing", "convoy", "sensing"])
def test_its_tables_are_those_of_one_process(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(name)
    agents = [agent for group in open_log(path).agents.values() for agent in group]
    whole, log = whole_and_merged(path, tmp_path, {"a": agents[1::3], "b": agents[2::3]})
    for each, folder in ((whole, "expected"), (log, "found")):
        export_tables(each, tmp_path / folder, CSV)
    expected, found = (sorted((tmp_path / folder).rglob("*.csv")) for folder in ("expected", "found"))
    assert len(expected) == len(found) > 5
    for one, other in zip(expected, found, strict=True):
        if one.name != "timing.csv":
            # Within an instant, knowledge stands in the order of the parts.
            assert sorted(one.read_bytes().splitlines()) == sorted(other.read_bytes().splitlines())


def test_how_sure_one_is_of_another_is_what_one_process_says(convoy: Path, tmp_path: Path) -> None:
    agents = [agent for group in open_log(convoy).agents.values() for agent in group]
    whole, log = whole_and_merged(convoy, tmp_path, {"a": agents[1::3], "b": agents[2::3]})
    said = 0
    for agent, other in permutations(agents, 2):
        expected, found = whole.beliefs(agent, other), log.beliefs(agent, other)
        np.testing.assert_array_equal(found.covariances, expected.covariances)
        said += int(np.isfinite(expected.covariances).any())
    assert said > 0


def test_all_verbs_take_the_merged_log(crossing: Path, tmp_path: Path) -> None:
    path = tmp_path / "whole.mcap"
    whole_and_merged(crossing, tmp_path, {"west": ["robot.0", "robot.1"], "odd": ["robot.5"]})
    for arguments in (
        ["inspect", path],
        ["log", "series", path, "robot:state"],
        ["recover", path],
        ["export", path, "--format", "foxglove", "--output", tmp_path / "foxglove.mcap"],
        ["replay", path, "--save", tmp_path / "replay.rrd"],
        ["plot", path, "--output", tmp_path / "plot.png", "--dpi", 20],
        ["run", path, "--quiet", "--output", tmp_path / "again.mcap"],
    ):
        status, _, trouble = called(arguments)
        assert (status, trouble) == (0, ""), arguments
    assert digest(open_log(tmp_path / "again.mcap")) == digest(open_log(crossing))


def test_the_order_of_the_files_does_not_matter(parts: list[Path], tmp_path: Path) -> None:
    made = set()
    for order in permutations(parts):
        joined(order, tmp_path / "whole.mcap")
        made.add((tmp_path / "whole.mcap").read_bytes())
    assert len(made) == 1


def test_within_an_instant_the_host_comes_first_and_then_members_by_name(
    sample: Path, parts: list[Path], tmp_path: Path
) -> None:
    log = joined(parts[::-1], tmp_path / "whole.mcap")
    agents = [each for each in log.messages() if each.channel.topic in ("/agents/robot/control", "/agents/car/state")]
    first = [(each.channel.topic, each.decode().rows) for each in agents if each.time == STEP]
    assert [(topic, None if rows is None else rows.tolist()) for topic, rows in first] == [
        ("/agents/robot/control", [0, 2]),
        ("/agents/robot/control", [1]),
        ("/agents/car/state", None),
    ]


def test_one_log_of_a_whole_run_becomes_itself(sample: Path, tmp_path: Path) -> None:
    log, whole = joined([sample], tmp_path / "whole.mcap"), open_log(sample)
    assert digest(log) == digest(whole)
    assert log.attachments == whole.attachments
    assert log.metadata == whole.metadata
    assert messages(log, "/timing") == messages(whole, "/timing")
    assert [each.topic for each in log.index.channels.values()] == [
        each.topic for each in whole.index.channels.values()
    ]
    # And so does one that was merged.
    joined([tmp_path / "whole.mcap"], tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == (tmp_path / "whole.mcap").read_bytes()


def test_the_manifest_says_who_ran_where_and_the_rest_is_the_hosts(
    sample: Path, parts: list[Path], tmp_path: Path
) -> None:
    log, whole = joined(parts, tmp_path / "whole.mcap"), open_log(sample)
    end = 39 * STEP
    assert log.manifest == whole.manifest | {
        "parts": [
            {"name": "host", "host": True, "agents": ["robot.0", "robot.2"], "start": 0, "end": end}
            | {"end_missing": False},
            {"name": "left", "host": False, "agents": ["robot.1"], "start": 0, "end": end, "end_missing": False},
            {"name": "right", "host": False, "agents": ["car"], "start": 0, "end": end, "end_missing": False},
        ]
    }
    names = log.attachments.keys() - {"manifest.json"}
    assert {name: log.attachments[name] for name in names} == {name: whole.attachments[name] for name in names}
    assert log.outcome == whole.outcome
    assert messages(log, "/timing") == messages(open_log(parts[0]), "/timing")


def test_a_host_without_members_is_a_run_of_its_own(sample: Path, tmp_path: Path) -> None:
    log = joined(split(sample, tmp_path, {}), tmp_path / "whole.mcap")
    assert digest(log).channels == digest(open_log(sample)).channels
    assert "part" not in log.manifest
    assert [part["name"] for part in log.manifest["parts"]] == ["host"]


def event(text: str) -> bytes:
    return v1.Event(name="told", source="run", text=text).SerializeToString()


def write_events(
    path: Path,
    name: str,
    entries: Sequence[tuple[int, str]],
    *,
    host: bool = False,
    agents: Sequence[str] = (),
    manifest: Mapping[str, Any] = MANIFEST,
    attach: Any = (),
    channel: tuple[Any, ...] | None = None,
) -> Path:
    """A part with events and nothing else, by time and text."""
    with LogWriter(path) as writer:
        part = {"name": name, "host": host, "agents": list(agents)}
        writer.attach("manifest.json", "application/json", json.dumps({**manifest, "part": part}).encode())
        for attached, data in dict(attach).items():
            writer.attach(attached, "", data)
        number = writer.channel(*(channel or ("/events", "Event")))
        for time, text in entries:
            writer.add(number, time, event(text))
        writer.finish({"status": "finished", "by": name})
    return path


def texts(log: Log) -> list[tuple[int, str]]:
    return [(each.time, each.text) for each in log.events()]


def test_records_of_several_parts_are_written_once_and_repeated_ones_of_one_part_stay(tmp_path: Path) -> None:
    host = write_events(tmp_path / "h.mcap", "host", [(1, "a"), (1, "a"), (1, "b"), (2, "a")], host=True)
    one = write_events(tmp_path / "1.mcap", "one", [(1, "b"), (1, "a"), (1, "c"), (2, "a"), (2, "a"), (2, "a")])
    two = write_events(tmp_path / "2.mcap", "two", [(1, "c"), (1, "a"), (1, "a"), (1, "a"), (2, "b"), (3, "a")])
    log = joined([host, one, two], tmp_path / "whole.mcap")
    assert texts(log) == [(1, each) for each in "aabca"] + [(2, each) for each in "aaab"] + [(3, "a")]
    assert merge(open_process_logs([host, one, two]), tmp_path / "whole.mcap").repeated == 2 + 1 + 2 + 1


def write_end(path: Path, name: str, why: str, *, host: bool = False, end: str = "finish") -> Path:
    """A part with nothing but why the run ended, and an event of a component that is called the same."""
    with LogWriter(path) as writer:
        part = {"name": name, "host": host, "agents": []}
        writer.attach("manifest.json", "application/json", json.dumps({**MANIFEST, "part": part}).encode())
        number = writer.channel("/events", "Event")
        for source, text in (("agents.car.steer", f"{name} parks"), ("run", why)):
            writer.add(number, STEP, v1.Event(name="finished", source=source, text=text).SerializeToString())
        if end == "finish":
            writer.finish({"status": "finished"})
    return path


@pytest.mark.parametrize("end", ["finish", "kill"])
def test_why_a_run_ended_is_what_the_host_says_if_it_lived_to_say_so(tmp_path: Path, end: str) -> None:
    told = end == "finish"
    host = write_end(tmp_path / "h.mcap", "host", "never there", host=True, end=end)
    one = write_end(tmp_path / "1.mcap", "one", "60 steps made")
    log = joined([one, host], tmp_path / "whole.mcap")
    assert [each for _, each in texts(log)] == [
        "host parks",
        "never there",
        "one parks",
        *["60 steps made"] * (not told),
    ]


@settings(max_examples=60)
@given(data=st.data())
def test_of_equal_messages_as_many_stay_as_the_part_has_that_has_most(data: st.DataObject) -> None:
    entries = st.lists(st.tuples(st.integers(0, 3), st.sampled_from("abc")), max_size=8).map(sorted)
    told = [data.draw(entries) for _ in range(data.draw(st.integers(1, 4)))]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [
            write_events(folder / f"{number}.mcap", str(number), each, host=not number)
            for number, each in enumerate(told)
        ]
        log = joined(paths, folder / "whole.mcap")
        assert Counter(texts(log)) == reduce(or_, map(Counter, told))


@settings(max_examples=40)
@given(data=st.data())
def test_however_a_log_is_taken_apart_merging_puts_it_together(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write_sample(folder / "sample.mcap", steps=data.draw(st.integers(0, 12)))
        whole = open_log(path)
        agents = [agent for group in whole.agents.values() for agent in group]
        place = {agent: data.draw(st.integers(0, 3)) for agent in agents}
        knows = data.draw(st.sets(st.sampled_from(["/events", "/contacts", "/messages", "/world/robot/state"])))
        paths = [
            write_part(
                whole,
                folder / f"{number}.mcap",
                str(number),
                [agent for agent in agents if place[agent] == number],
                host=number == 0,
                keep=None if number == 0 else lambda message: message.channel.topic in knows,
            )
            for number in range(4)
        ]
        chance = data.draw(st.randoms(use_true_random=False))
        chance.shuffle(paths)
        log = joined(paths, folder / "whole.mcap")
        assert contents(log) == contents(whole)
        assert messages(log, "/timing") == messages(whole, "/timing")


def test_a_process_that_was_killed_and_came_back_has_two_parts(sample: Path, tmp_path: Path) -> None:
    whole, agents = open_log(sample), ["robot.1", "car"]
    host = split(sample, tmp_path, {"left": agents})[0]
    killed = write_part(whole, tmp_path / "left-1.mcap", "left", agents, until=20 * STEP, end="kill")
    with open(killed, "ab") as file:
        file.write(b"\x06half a chunk")
    late = write_part(whole, tmp_path / "left-2.mcap", "left", agents, start=30 * STEP)
    log = joined([late, host, killed], tmp_path / "whole.mcap")
    assert [(part["name"], part["start"], part["end"], part["end_missing"]) for part in log.manifest["parts"]] == [
        ("host", 0, 39 * STEP, False),
        ("left", 0, 19 * STEP, True),
        ("left", 30 * STEP, 39 * STEP, False),
    ]
    assert log.series("car", "state").times.tolist() == [STEP * step for step in [*range(20), *range(30, 40)]]
    assert messages(log, "/world/robot/state") == messages(whole, "/world/robot/state")
    assert log.outcome == whole.outcome
    # The run has its end; that of a member is missing.
    assert present(log.recovery)["log"] == "left-1.mcap"
    assert present(log.recovery)["text"].startswith("the log breaks off after 0.95 s of simulated time")
    assert (present(log.recovery)["lost"], present(log.recovery)["end_missing"]) == (True, False)


def test_a_member_that_is_killed_anywhere_costs_what_it_had_not_flushed(tmp_path: Path) -> None:
    whole = open_log(write_sample(tmp_path / "sample.mcap"))
    agents = ["robot.1", "car"]
    host = write_part(whole, tmp_path / "host.mcap", "host", ["robot.0", "robot.2"], host=True)
    member = write_part(whole, tmp_path / "member.mcap", "member", agents)
    data, cut = member.read_bytes(), tmp_path / "cut.mcap"
    expected = contents(whole)
    manifest = next(each for each in open_log(member).index.attachments if each.name == "manifest.json")
    announced = manifest.offset + manifest.length
    for place in random.Random(3).sample(range(len(data)), 40):
        cut.write_bytes(data[:place])
        if place < announced:
            with pytest.raises(LogError, match=re.escape(str(cut))):
                open_process_logs([host, cut])
            continue
        parts = open_process_logs([host, cut])
        merge(parts, tmp_path / "whole.mcap")
        log = open_log(tmp_path / "whole.mcap")
        assert log.verify() is None
        assert parts[1].log.damage is not None
        assert present(log.recovery)["lost"] == parts[1].log.damage.lost
        found = contents(log)
        assert all(found[topic] == expected[topic] for topic in expected if not topic.startswith("/agents/"))
        assert all(found[topic] <= expected[topic] for topic in found)


def test_a_host_that_was_killed_leaves_a_run_without_an_outcome(sample: Path, tmp_path: Path) -> None:
    whole = open_log(sample)
    host = write_part(whole, tmp_path / "h.mcap", "host", [], host=True, until=10 * STEP, end="kill")
    member = write_part(whole, tmp_path / "m.mcap", "member", ["car"], until=8 * STEP, end="kill")
    log = joined([host, member], tmp_path / "whole.mcap")
    assert log.outcome is None
    assert present(log.recovery)["end_missing"]
    assert present(log.recovery)["log"] == "h.mcap, m.mcap"
    assert "h.mcap: the log breaks off after 0.45 s" in present(log.recovery)["text"]
    assert "m.mcap: the log breaks off after 0.35 s" in present(log.recovery)["text"]


def test_chunks_and_attachments_that_are_damaged_are_left_out_and_told(
    sample: Path, parts: list[Path], tmp_path: Path
) -> None:
    broken = bytearray(parts[0].read_bytes())
    log = open_log(parts[0])
    span, place = log.index.spans[0], next(each for each in log.index.attachments if each.name == "resolved.yaml")
    for offset, length in ((span.offset, span.length), (place.offset, place.length)):
        broken[offset + FRAME.size + length // 2] ^= 0xFF
    parts[0].write_bytes(broken)
    found = joined(parts, tmp_path / "whole.mcap")
    assert present(found.recovery)["chunks_skipped"] == present(found.recovery)["attachments_skipped"] == 1
    assert present(found.recovery)["lost"]
    # Members have the scenario, too.
    assert found.attachments["resolved.yaml"] == open_log(sample).attachments["resolved.yaml"]


def test_losses_before_the_recovery_of_a_part_are_kept(sample: Path, parts: list[Path], tmp_path: Path) -> None:
    parts[2].write_bytes(parts[2].read_bytes()[: open_log(parts[2]).index.spans[4].offset])
    assert called(["recover", parts[2], "--output", tmp_path / "sound.mcap"])[0] == 3
    log = joined([*parts[:2], tmp_path / "sound.mcap"], tmp_path / "whole.mcap")
    assert present(log.recovery)["log"] == "right.mcap"
    assert present(log.recovery)["text"].startswith("the log breaks off")
    again = joined([tmp_path / "whole.mcap"], tmp_path / "again.mcap")
    assert present(again.recovery)["text"] == present(log.recovery)["text"]


def refused(paths: Sequence[Path], folder: Path) -> str:
    """What is said of files that cannot be merged: one sentence, the same in any order."""
    said = set()
    for order in (paths, paths[::-1]):
        with pytest.raises(LogError) as caught:
            merge(open_process_logs(order), folder / "whole.mcap")
        said.add(str(caught.value).replace(f"{folder}/", ""))
    assert not (folder / "whole.mcap").exists()
    assert len(said) == 1
    return said.pop()


def test_parts_without_a_host_or_with_two_are_refused(parts: list[Path], tmp_path: Path) -> None:
    said = refused(parts[1:], tmp_path)
    assert said == "the host's part is missing: name it beside left.mcap, which is a member's"
    shutil.copy(parts[0], tmp_path / "other.mcap")
    said = refused([*parts, tmp_path / "other.mcap"], tmp_path)
    assert said == "host.mcap and other.mcap are both a host's part: leave out that of another run"


def test_the_log_of_a_whole_run_is_no_part(sample: Path, parts: list[Path], tmp_path: Path) -> None:
    said = refused([sample, *parts[1:]], tmp_path)
    assert said == "sample.mcap is the log of a whole run and no part of one: leave it out"


def test_a_part_that_is_named_twice_is_refused(parts: list[Path], tmp_path: Path) -> None:
    assert refused([*parts, parts[1]], tmp_path) == "left.mcap is named twice: name each part once"


def test_an_agent_that_ran_in_two_places_at_a_time_is_refused(sample: Path, parts: list[Path], tmp_path: Path) -> None:
    other = write_part(open_log(sample), tmp_path / "third.mcap", "third", ["car"], start=38 * STEP)
    said = refused([*parts, other], tmp_path)
    assert said == (
        "car is in both right.mcap and third.mcap from 1.9 s to 1.95 s: leave out the one that is not of this run"
    )


@pytest.mark.parametrize(
    ("manifest", "attach", "what"),
    [
        ({"name": "other"}, {}, "their scenarios are called sample and other"),
        ({"seed": 8}, {}, "their seeds are 7 and 8"),
        ({"roster": ["robot.0"]}, {}, "their manifests do not name the same agents and entities"),
        ({}, {"resolved.yaml": b"two"}, "their scenarios (resolved.yaml) differ"),
        ({}, {"versions.json": b'{"symaware-cli": "0.3"}'}, "SymAware 0.1 and 0.3 wrote them"),
    ],
)
def test_parts_of_different_runs_are_refused(
    tmp_path: Path, manifest: dict[str, Any], attach: dict[str, Any], what: str
) -> None:
    usual = {"resolved.yaml": b"one", "versions.json": b'{"symaware-cli": "0.1"}'}
    host = write_events(tmp_path / "host.mcap", "host", [], host=True, attach=usual)
    member = write_events(tmp_path / "m.mcap", "m", [], manifest=MANIFEST | manifest, attach=usual | attach)
    assert refused([host, member], tmp_path) == f"host.mcap and m.mcap are not of one run: {what}"


def test_channels_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    paths = [
        write_events(
            tmp_path / f"{name}.mcap", name, [], host=name == "a", channel=("/x", message, {"columns": columns})
        )
        for name, message, columns in (("a", "Rows", "x"), ("b", "Rows", "y"), ("c", "Event", "x"))
    ]
    assert refused(paths[:2], tmp_path) == "the columns of /x are not the same in a.mcap and b.mcap"
    assert refused(paths[::2], tmp_path) == "the messages of /x are not the same in a.mcap and c.mcap"


@pytest.mark.parametrize("part", [{}, {"name": "a"}, "host", {"name": "a", "host": True, "agents": [1]}])
def test_a_manifest_that_does_not_say_whose_part_it_is_is_refused(tmp_path: Path, part: dict[str, Any] | str) -> None:
    with LogWriter(tmp_path / "a.mcap") as writer:
        writer.attach("manifest.json", "", json.dumps({**MANIFEST, "part": part}).encode())
        writer.finish({})
    said = refused([tmp_path / "a.mcap"], tmp_path)
    assert said == "the manifest in a.mcap is damaged: leave it out"


def test_a_log_of_another_program_is_refused(parts: list[Path], tmp_path: Path) -> None:
    foreign, early = tmp_path / "foreign.mcap", tmp_path / "early.mcap"
    with open(foreign, "wb") as file:
        writer = Writer(file)
        writer.start()
        untyped(writer).finish()
    assert refused([*parts, foreign], tmp_path) == "foreign.mcap was not written by SymAware: leave it out"
    LogWriter(early).abort()
    assert refused([*parts, early], tmp_path) == "early.mcap was cut off before its manifest: leave it out"
    assert refused([*parts, tmp_path / "none.mcap"], tmp_path) == "there is no file none.mcap"


def test_no_part_is_overwritten(parts: list[Path], tmp_path: Path) -> None:
    before = [path.read_bytes() for path in parts]
    for path in parts:
        with pytest.raises(LogError, match="it is an input file"):
            merge(open_process_logs(parts), path)
    (tmp_path / "link.mcap").symlink_to(parts[1])
    with pytest.raises(LogError, match="it is an input file"):
        merge(open_process_logs(parts), tmp_path / "link.mcap")
    assert [path.read_bytes() for path in parts] == before


def test_an_unwritable_place_is_reported_by_its_name(parts: list[Path], tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"cannot write .*missing/whole.mcap: its folder does not exist"):
        merge(open_process_logs(parts), tmp_path / "missing" / "whole.mcap")


def write_long(path: Path, name: str, rows: Sequence[int], *, steps: int, host: bool = False) -> Path:
    """A part of a group of 200 with states and events for so many steps."""
    agents = [f"robot.{row}" for row in range(200)]
    manifest = {"format": 1, "groups": {"robot": {"agents": agents}}, "roster": agents}
    random = np.random.default_rng(len(name))
    with LogWriter(path) as writer:
        part = {"name": name, "host": host, "agents": [agents[row] for row in rows]}
        writer.attach("manifest.json", "", json.dumps(manifest | {"part": part}).encode())
        state, events = writer.channel("/agents/robot/state", "Rows"), writer.channel("/events", "Event")
        for step in range(steps):
            writer.add(state, step * STEP, wire.encode_rows(random.normal(size=(len(rows), 6)), rows))
            writer.add(events, step * STEP, event(f"step {step}"))
        writer.finish({})
    return path


def test_memory_does_not_grow_with_the_logs(tmp_path: Path) -> None:
    def peak(steps: int) -> int:
        paths = [
            write_long(tmp_path / f"{place}.mcap", str(place), range(place, 200, 4), steps=steps, host=not place)
            for place in range(4)
        ]
        tracemalloc.start()
        try:
            merge(open_process_logs(paths), tmp_path / "whole.mcap")
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    short, long = peak(300), peak(1200)
    # 9 MB more of messages; the index of each chunk is kept.
    assert long < short + 1_000_000
    assert long < 20_000_000
