import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT
from simulating import in_process

from symaware_cli.views.viewer import Viewer, require, viewer

SCENARIO = CHECKOUT / "scenarios" / "hello.yaml"


@pytest.fixture(scope="module")
def screen() -> Iterator[Viewer]:
    """A viewer that already runs, without a window."""
    require()
    with viewer(headless=True) as running:
        yield running


def symaware(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "symaware_cli", *map(str, arguments)]


def start(*arguments: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(symaware(*arguments), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def done(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(symaware(*arguments), capture_output=True, text=True, timeout=60, check=False, **options)


def ends_in_viewer(screen: Viewer) -> list[int]:
    """How far [ns] each of the recordings in a viewer goes."""
    from rerun.experimental import ViewerClient

    state = ViewerClient.connect(screen.url).get_state()
    return [recording.timelines[0].end or 0 for recording in state.recordings if recording.timelines]


def test_a_run_appears_in_the_viewer_and_its_log_is_that_of_any_other_run(screen: Viewer, tmp_path: Path) -> None:
    live, plain = tmp_path / "live.mcap", tmp_path / "plain.mcap"
    run = done("run", SCENARIO, "-o", live, "--connect", screen.url, "--json")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["status"] == "finished"
    assert 12_000_000_000 in ends_in_viewer(screen)
    assert in_process("run", SCENARIO, "-o", plain).returncode == 0
    digests = [in_process("log", "digest", log).stdout for log in (live, plain)]
    assert digests[0] == digests[1] != ""


def test_a_run_that_is_not_recorded_can_be_watched_and_leaves_nothing(screen: Viewer, tmp_path: Path) -> None:
    before = len(ends_in_viewer(screen))
    surroundings = {**os.environ, "TMPDIR": str(tmp_path)}
    run = done("run", SCENARIO, "--no-record", "--connect", screen.url, cwd=tmp_path, env=surroundings)
    assert run.returncode == 0, run.stderr
    assert len(ends_in_viewer(screen)) == before + 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_log_is_shown_while_it_grows(screen: Viewer, tmp_path: Path) -> None:
    log = tmp_path / "growing.mcap"
    follower = start("replay", log, "--follow", "--connect", screen.url)
    run = start("run", SCENARIO, "-o", log, "--set", "run.duration=1000000", "-q")
    try:
        seen: list[int] = []
        deadline = time.monotonic() + 60
        while len(set(seen)) < 3 and time.monotonic() < deadline:
            time.sleep(0.3)
            seen += [end for end in ends_in_viewer(screen) if end > 12_000_000_000]
        assert len(set(seen)) >= 3, "the recording did not grow"
    finally:
        run.send_signal(signal.SIGINT)
        assert run.wait(60) == 130
    assert follower.wait(120) == 0


def test_without_a_screen_the_run_is_made_all_the_same(tmp_path: Path) -> None:
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    run = done("run", SCENARIO, "--live", "-o", tmp_path / "a.mcap", env=bare)
    assert run.returncode == 0
    assert "hello: finished" in run.stdout
    assert "no screen" in run.stderr
    assert (tmp_path / "a.mcap").exists()


def test_following_is_refused_where_a_file_is_asked_for(tmp_path: Path) -> None:
    refused = in_process("replay", tmp_path / "a.mcap", "--follow", "--save", tmp_path / "a.rrd")
    assert refused.returncode == 2
    assert "--follow shows a whole log" in refused.stderr
