"""A log in a file, in a picture, in part."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from plot_logs import AIRCRAFT, YARD, log_of
from rerun_files import STEP, Recording, Script, coloured, group, needs_graphics, pixels, saved

from symaware_cli import Log, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import wire
from symaware_cli.log.error import LogError
from symaware_cli.views import chunk
from symaware_cli.views.blueprint import content_of
from symaware_cli.views.replay_session import replay_session
from symaware_cli.views.views import run_view_of

#: A region beside the robots of hello.yaml, and one far larger than their world.
NEAR_AND_FAR = "{near: {box: [-9, -7, 1, 8]}, far: {circle: {centre: [0, 0], radius: 5000}}}"
BODY = "/world/agents/cart/body", "Boxes3D:centers"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return log_of(tmp_path_factory.mktemp("yard"), YARD)


def content(recording: Recording) -> dict[tuple[str, str], list[tuple[int | None, list[Any] | None]]]:
    return {
        key: [(time, value) for time, value in rows]
        for key, rows in recording.rows.items()
        if "RecordingInfo" not in key[1]
    }


def test_an_rrd_has_its_blueprint_inside_and_simulated_time_only(log: Log, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    replay_session(log).save(tmp_path / "a.rrd")
    assert Recording(tmp_path / "a.rrd").blueprints == 1
    names = {name for chunk in RrdReader(tmp_path / "a.rrd").stream() for name in chunk.timeline_names}
    assert names == {"time"}


def test_two_files_of_one_log_say_the_same(log: Log, tmp_path: Path) -> None:
    # Rerun orders what belongs to different entities by when its threads come to it.
    one, other = (sorted(content(saved(log, tmp_path)).items()) for _ in range(2))
    assert repr(one) == repr(other)


def test_a_log_cut_into_small_chunks_makes_the_same_recording(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = content(saved(log, tmp_path))
    original = chunk.ChunkReader.chunks
    monkeypatch.setattr(chunk.ChunkReader, "chunks", lambda self, messages: original(self, messages, 3000))
    parts = content(saved(log, tmp_path))
    assert parts.keys() == whole.keys()
    for key, rows in whole.items():
        assert repr(parts[key]) == repr(rows), key


def test_an_interval_begins_with_the_values_that_hold_then(log: Log, tmp_path: Path) -> None:
    begin, end = 1_020_000_000, 2_000_000_000
    part, whole = saved(log, tmp_path, start=begin, end=end), saved(log, tmp_path)
    times = part.times(*BODY)
    assert times[0] == begin
    assert times[1] > begin
    assert times[-1] < end
    before = np.searchsorted(whole.times(*BODY), begin, side="right") - 1
    assert part.values(*BODY)[0] == whole.values(*BODY)[before]
    # Said once, at the beginning of the run, and true ever since.
    goals = "/world/agents/cart/goal", "LineStrips3D:strips"
    assert (part.times(*goals), part.values(*goals)) == ([begin], whole.values(*goals))
    assert (
        all(begin <= time < end for time in part.times("/log/events", "TextLog:text"))
        if ("/log/events" in part.entities)
        else True
    )


def test_a_contact_that_lasts_into_a_stretch_is_shown_there(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1", shape={"circle": {"radius": 0.5}})})
    for step in range(10):
        script.say("/world/a/state", step * STEP, wire.encode_rows([[0.0, 0.0], [0.9, 0.1 * step]]), "Rows")
        if step == 1:
            script.contact(step * STEP, "a.0", "a.1")
    recording = saved(script.finish(), tmp_path, start=5 * STEP)
    assert recording.times("/world/contacts", "LineStrips3D:strips")[0] == 5 * STEP


def test_an_empty_interval_is_reported(log: Log) -> None:
    with pytest.raises(LogError, match="nothing to show in that interval"):
        replay_session(log, start=10_000_000_000)


def test_a_log_that_broke_off_before_its_first_message_is_reported(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"has nothing to show$"):
        replay_session(Script(tmp_path / "a.mcap", {"a": group("a")}).finish())


def test_a_log_of_many_kinds_of_messages_and_no_models_is_a_damaged_one(
    sample_writer_path: Log, tmp_path: Path
) -> None:
    with pytest.raises(LogError, match=r"manifest in .* is damaged"):
        replay_session(sample_writer_path)


@pytest.fixture
def sample_writer_path(tmp_path: Path) -> Log:
    from sample_log import write_sample

    from symaware_cli import open_log

    return open_log(write_sample(tmp_path / "sample.mcap"))


@needs_graphics
@pytest.mark.parametrize(("scenario", "agents"), [(YARD, ()), (YARD, ["cart.1"]), (AIRCRAFT, ())])
def test_the_viewer_shows_it_without_complaint(scenario: str, agents: Sequence[str], tmp_path: Path) -> None:
    opened = log_of(tmp_path, scenario)
    shown = replay_session(opened, agents)
    views = shown.picture(tmp_path / "a.png", None, "900x600")
    assert [report for view in views for report in view.reports] == []
    names = [view.name for view in views]
    assert "Scene" in names
    assert {"Events", "Closest two agents [m]; they touch at 0"} <= set(names)
    assert all(f"as {agent} believes" in names for agent in shown.detail.focus)
    picture = pixels((tmp_path / "a.png").read_bytes())
    assert picture.shape[:2] == (600, 900)
    # The half with the scene.
    assert coloured(picture[80:560, :540]) > 100


@pytest.mark.slow
@needs_graphics
@pytest.mark.parametrize(("scenario", "duration"), [("crossing", 14), ("circle-swap", 10), ("swarm", 3)])
def test_the_examples_are_shown_without_complaint_be_they_few_or_a_thousand(
    scenario: str, duration: int, tmp_path: Path
) -> None:
    opened = log_of(tmp_path, f"{scenario}.yaml", f"run.duration={duration}")
    views = replay_session(opened).picture(tmp_path / "a.png", int(0.8 * duration * 1e9), "1200x800")
    assert [report for view in views for report in view.reports] == []
    assert {"Scene", "Risk", "Closest two agents [m]; they touch at 0", "Events"} <= {view.name for view in views}
    picture = pixels((tmp_path / "a.png").read_bytes())
    assert coloured(picture[80:760, :740]) > 1000


def test_regions_are_within_the_view_unless_they_are_far_larger_than_the_run(tmp_path: Path) -> None:
    found = []
    for number, regions in enumerate(("{}", NEAR_AND_FAR)):
        path, scenario = tmp_path / f"{number}.mcap", CHECKOUT / "scenarios" / "hello.yaml"
        execute(build(scenario, ["run.duration=1", f"regions={regions}"]), path)
        log = open_log(path)
        found.append(content_of(log, run_view_of(log)))
    bare, shown = found
    size = (bare.high - bare.low).max()
    assert bare.low[0] > -9 > shown.low[0]
    assert 2.0 * size < (shown.high - shown.low).max() <= 3.01 * size
