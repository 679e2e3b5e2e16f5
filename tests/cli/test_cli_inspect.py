"""`symaware inspect` and `symaware log`."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.writer import Writer
from sample_log import write_sample
from simulating import Command, untyped
from typer.testing import CliRunner, Result

from symaware_cli import open_log
from symaware_cli.cli.application import application
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.digest import digest
from symaware_cli.log.repair import recover
from symaware_cli.log.writer import LogWriter


@pytest.fixture
def log(command: Command, scenarios: Path, tmp_path: Path) -> Path:
    assert command("run", scenarios / "hello.yaml", "--set", "run.duration=1", "-q").returncode == 0
    return tmp_path / "hello.mcap"


def test_contacts_are_those_that_the_summary_of_the_run_counts(
    command: Command, scenarios: Path, tmp_path: Path
) -> None:
    told = command("run", scenarios / "head-on.yaml").stdout
    counted = next(line.split()[1].rstrip(",") for line in told.splitlines() if line.startswith("  contacts"))
    summary = command("inspect", tmp_path / "head-on.mcap").stdout
    assert int(counted) > 0
    assert f"  contacts  {counted}\n" in summary
    assert "contact " not in summary
    assert json.loads(command("inspect", tmp_path / "head-on.mcap", "--json").stdout)["contacts"] == int(counted)


def test_it_shows_agents_times_rates_and_versions(log: Path, command: Command) -> None:
    done = command("inspect", log)
    assert (done.returncode, done.stderr) == (0, "")
    for said in (
        *("finished", "hello, seed 7, synchronous", "robot (4)", "0 to 1 s, 20 steps of 0.05 s", "scenario/hello.yaml"),
        *("symaware-cli", "numpy", "/world/robot/state", "/agents/robot/control", "x [m], y [m], heading [rad]"),
    ):
        assert said in done.stdout
    overview = json.loads(command("inspect", log, "--json").stdout)
    assert overview["lost"] is False
    assert overview["steps"] == 20
    assert overview["agents"] == {"robot": 4}


def test_a_gap_is_where_agents_are_not_told_of_and_not_where_an_entity_rests(
    tmp_path: Path, inspect: Callable[..., Result]
) -> None:
    with LogWriter(tmp_path / "a.mcap") as writer:
        manifest = {
            "format": 1,
            "groups": {"car": {"agents": ["car"]}},
            "entities": {"ball": {}},
            "roster": ["car", "ball"],
        }
        writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
        channels = [writer.channel(f"/world/{name}/state", "Rows") for name in ("car", "ball")]
        for step in (0, 1, 2, 7, 8, 9):
            for channel in channels:
                writer.add(channel, step * 10**9, b"")
        writer.finish({"status": "finished"})
    said = inspect(tmp_path / "a.mcap").stdout
    assert [line.split(maxsplit=1) for line in said.splitlines() if line.startswith("  gap")] == [
        ["gap", "/world/car/state has nothing between 2 s and 7 s"]
    ]


def test_events_are_listed_for_people_and_for_tools(log: Path, command: Command) -> None:
    done = command("log", "events", log)
    assert done.returncode == 0
    assert done.stdout.splitlines()[0].split()[:4] == ["0.0000", "s", "INFO", "started"]
    events = json.loads(command("log", "events", log, "--json").stdout)
    assert [events[0]["name"], events[-1]["name"]] == ["started", "finished"]


def test_digests_are_those_of_the_library(log: Path, command: Command) -> None:
    expected = digest(open_log(log))
    lines = command("log", "digest", log).stdout.splitlines()
    assert lines[-1] == f"{expected.combined}  combined"
    assert json.loads(command("log", "digest", log, "--json").stdout)["channels"] == expected.channels


def test_a_truncated_log_is_reported_with_exit_status_3_by_every_view(log: Path, command: Command) -> None:
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    for words in (["inspect"], ["inspect", "--json"], ["log", "events"], ["log", "digest"]):
        done = command(*words, log)
        assert done.returncode == 3
        assert "breaks off" in done.stdout + done.stderr


@pytest.mark.parametrize("name", ["empty.mcap", "junk.mcap", "begun.mcap", "missing.mcap", "."])
def test_a_file_that_is_no_log_is_wrong_input(name: str, command: Command, tmp_path: Path) -> None:
    for each, content in {"empty": b"", "junk": b"junk", "begun": b"\x89MCAP0\r\n"}.items():
        (tmp_path / f"{each}.mcap").write_bytes(content)
    done = command("inspect", name)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


def test_with_json_files_that_are_no_log_are_reported_as_well(command: Command) -> None:
    assert json.loads(command("inspect", "missing.mcap", "--json").stdout)["error"] == "there is no file missing.mcap"


VIEWS = ("events", "messages", "contacts", "series", "digest")


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    """A log of three robots and a car with entries of every kind."""
    return write_sample(tmp_path / "sample.mcap")


@pytest.fixture
def inspect() -> Callable[..., Result]:
    """Run `symaware inspect ARGUMENTS` in this process, or `symaware log VIEW` if the first argument is a view."""

    def run(*arguments: object, status: int = 0) -> Result:
        words = ["log"] if str(arguments[0]) in VIEWS else ["inspect"]
        done = CliRunner().invoke(application, [*words, *map(str, arguments)])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exc_info
        assert done.exit_code == status, done.output
        return done

    return run


def test_events_are_filtered_by_agent_name_source_level_time_and_number(
    log: Path, inspect: Callable[..., Result]
) -> None:
    def times(*filters: object) -> list[float]:
        return [event["time"] / 1e9 for event in json.loads(inspect("events", log, "--json", *filters).stdout)]

    everything = times()
    assert times("--name", "contact") == [time for time in everything if 0 < time < 1]
    assert times("--source", "run") == [0.0, 1.0]
    assert times("--level", "warning") == times("--name", "contact")
    assert times("--agents", "robot.0") == times("--agents", "robot.0", "--level", "Warning")
    assert times("--from", 1) == [1.0]
    assert times("--to", 0) == [0.0]
    assert times("--limit", 1) == [0.0]
    assert times("--limit", 0) == []


def test_messages_are_listed_with_their_latency(sample: Path, inspect: Callable[..., Result]) -> None:
    lines = inspect("messages", sample).stdout.splitlines()
    assert lines[0] == '    0.1500 s  SENT       robot.0 to car  hello  {"text": "hello"}'
    assert lines[1] == "    0.2000 s  DELIVERED  robot.0 to car  hello  after 0.05 s"
    assert len(lines) == 8
    entries = json.loads(inspect("messages", sample, "--json", "--stage", "delivered", "--agents", "car").stdout)
    assert [entry["latency"] for entry in entries] == [50_000_000] * 4
    assert json.loads(inspect("messages", sample, "--json", "--agents", "robot.1,robot.2").stdout) == []
    assert len(json.loads(inspect("messages", sample, "--json", "--kind", "h*", "--from", "1.65").stdout)) == 2


def test_contacts_are_listed_with_place_and_depth(sample: Path, inspect: Callable[..., Result]) -> None:
    lines = inspect("contacts", sample).stdout.splitlines()
    assert lines[0] == "    0.1500 s  BEGIN  car and wall  at (1, 2) m, 0.1 m deep"
    entries = json.loads(inspect("contacts", sample, "--json", "--limit", 2).stdout)
    assert [(entry["a"], entry["b"], entry["point"]) for entry in entries] == [("car", "wall", [1.0, 2.0])] * 2


def test_a_series_is_a_table_with_units_and_extremes(sample: Path, inspect: Callable[..., Result]) -> None:
    lines = inspect("series", sample, "robot.1:world", "--every", "0.5").stdout.splitlines()
    assert lines[0].split() == ["time", "[s]", "x", "[m]", "y", "[m]", "heading", "[rad]"]
    assert [line.split()[0] for line in lines[1:5]] == ["0", "0.5", "1", "1.5"]
    values = open_log(sample).series("robot.1", "world").values
    assert [float(word) for word in lines[1].split()[1:]] == pytest.approx(values[0], rel=1e-5)
    for line, word, expected in zip(
        lines[6:], ("minimum", "mean", "maximum"), (values.min(0), values.mean(0), values.max(0)), strict=False
    ):
        assert line.split()[0] == word
        assert [float(number) for number in line.split()[1:]] == pytest.approx(expected, rel=1e-5)
    assert lines[-1] == "of 40 instants, 4 of them shown"


def test_a_series_for_scripts_has_times_values_and_extremes(sample: Path, inspect: Callable[..., Result]) -> None:
    found = json.loads(inspect("series", sample, "robot:state:y", "--from", "0.1", "--to", 0.2, "--json").stdout)
    assert found["columns"] == ["robot.0 y", "robot.1 y", "robot.2 y"]
    assert found["units"] == ["m"] * 3
    assert found["times"] == [100_000_000, 150_000_000, 200_000_000]
    series = open_log(sample).series("robot", "state")
    assert found["values"] == series.values[2:5, :, 1].tolist()
    assert found["maximum"] == series.values[2:5, :, 1].max(axis=0).tolist()
    assert (
        json.loads(inspect("series", sample, "robot:state:1", "--json", "--limit", 1).stdout)["columns"]
        == (found["columns"])
    )


def test_a_series_without_values_is_an_empty_table(sample: Path, inspect: Callable[..., Result]) -> None:
    lines = inspect("series", sample, "car:state", "--from", 1000).stdout.splitlines()
    assert lines[-1] == "of 0 instants"
    assert lines[2].split() == ["minimum", "-", "-", "-"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("events --from 2 --to 1", "--from 2 is later than --to 1"),
        ("events --from nan", "--from takes a time in seconds, not nan"),
        ("series car:state --every 0", "--every takes a time above 0, not 0"),
        ("events --agents robto", "has no agent, group or entity 'robto'; did you mean `robot`?"),
        ("messages --agents robot.0,robot.3", "has no agent, group or entity 'robot.3'"),
        ("series robot", "a series is NAME:FIELD or NAME:FIELD:COLUMN"),
        ("series robto:state", "did you mean `robot`?"),
        ("series robot:staet", "did you mean `state`?"),
        ("series robot:state:headign", "there are x, y, heading; did you mean `heading`?"),
        ("series robot:state:3", "has no column '3'"),
        ("series car:risk", "has no risk of 'car' (no channel /agents/car/risk); there is state"),
    ],
)
def test_an_unshowable_log_is_reported_in_a_sentence(
    sample: Path, inspect: Callable[..., Result], options: str, sentence: str
) -> None:
    view, *words = options.split()
    done = inspect(view, sample, *words, status=2)
    assert sentence in done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert sentence in json.loads(inspect(view, sample, *words, "--json", status=2).stdout)["error"]


def test_filters_without_matches_are_no_failure_and_reported_on_stderr(
    sample: Path, inspect: Callable[..., Result]
) -> None:
    for options in (["--name", "computd"], ["--source", "nowhere"], ["--from", "100"], ["--name", "failed"]):
        done = inspect("events", sample, *options)
        assert done.stdout == ""
        assert done.stderr.startswith("symaware: none of the events matches; there are computed")
        assert ("did you mean `computed`?" in done.stderr) == (options[1] == "computd")
        assert json.loads(inspect("events", sample, *options, "--json").stdout) == []
    assert "there are hello" in inspect("messages", sample, "--kind", "bye").stderr


def test_an_empty_list_is_reported_as_empty(log: Path, inspect: Callable[..., Result]) -> None:
    done = inspect("messages", log)
    assert (done.stdout, done.stderr) == ("", f"symaware: {log} has no messages\n")


def test_a_damaged_entry_ends_the_list_with_a_sentence_and_the_array_stays_whole(
    tmp_path: Path, inspect: Callable[..., Result]
) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/events", "Event")
        writer.add(channel, 0, v1.Event(name="good").SerializeToString())
        writer.add(channel, 1, v1.Event(name="bad", data="{").SerializeToString())
        writer.finish({})
    done = inspect("events", writer.path, "--json", status=2)
    assert [event["name"] for event in json.loads(done.stdout)] == ["good"]
    assert f"the messages on /events in {writer.path} do not fit together: at 1 ns" in done.stderr


def test_a_recovered_log_says_what_was_lost_and_is_sound(
    sample: Path, inspect: Callable[..., Result], tmp_path: Path
) -> None:
    sample.write_bytes(sample.read_bytes()[: sample.stat().st_size // 2])
    recover(open_log(sample), tmp_path / "new.mcap")
    text = inspect(tmp_path / "new.mcap").stdout
    assert "new.mcap: " in text.splitlines()[0]
    assert "recovered from sample.mcap: the log breaks off after" in text
    found = json.loads(inspect(tmp_path / "new.mcap", "--json").stdout)
    assert found["recovered"].startswith("from sample.mcap: the log breaks off after")
    assert (found["damage"], found["lost"], found["status"]) == (None, False, "broken off")


def test_of_somebody_elses_log_the_channels_are_shown_and_nothing_else(
    tmp_path: Path, inspect: Callable[..., Result]
) -> None:
    path = tmp_path / "foreign.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for topic in ("/timing", "/events", "/world/robot/state"):
            channel = writer.register_channel(topic, "json", writer.register_schema("other.Thing", "jsonschema", b"{}"))
            writer.add_message(channel, 5, b"{}", 5)
        untyped(writer).finish()
    shown = inspect(path).stdout
    assert "not written by SymAware; only its channels can be shown" in shown
    assert "/world/robot/state" in shown
    for view in ("events", "messages", "contacts"):
        assert len(inspect(view, path, status=2).stderr.splitlines()) == 1
    assert len(inspect("series", path, "robot:world", status=2).stderr.splitlines()) == 1
    assert "it has no events" in inspect("events", path, status=2).stderr
    assert inspect("digest", path).stdout.endswith("combined\n")
