"""Episodes in a viewer without a window."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_scenarios import HEAD_ON, head_on

import symaware_cli as sa
from symaware_cli.views.viewer import Viewer, require, viewer


@pytest.fixture(scope="module")
def screen() -> Iterator[Viewer]:
    """A viewer that already runs."""
    require()
    with viewer(headless=True) as running:
        yield running


def ends(screen: Viewer) -> list[int]:
    """Return the last instant of each recording in a viewer [ns]."""
    from rerun.experimental import ViewerClient

    state = ViewerClient.connect(screen.url).get_state()
    return sorted(each.timelines[0].end or 0 for each in state.recordings if each.timelines)


def test_each_episode_appears_in_the_viewer_and_is_that_of_any_other_environment(
    screen: Viewer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    changes = {"run.duration": 0.3}
    shown, other = head_on(changes=changes, render_mode="human", connect=screen.url), head_on(changes=changes)
    for seed in (1, 2):
        shown.reset(seed=seed)
        other.reset(seed=seed)
        steps = 0
        while shown.agents and steps < 4 + seed:  # the second one to its end
            actions = {"robot.0": np.array([0.5, 0.1])}
            observations, *_ = shown.step(actions)
            expected, *_ = other.step(actions)
            assert {id: each.tobytes() for id, each in observations.items()} == {
                id: each.tobytes() for id, each in expected.items()
            }
            assert shown.render() is None
            steps += 1
    shown.close()
    assert ends(screen) == [250_000_000, 300_000_000]
    assert list(tmp_path.iterdir()) == []


def test_an_environment_of_gymnasium_is_shown_alike(screen: Viewer) -> None:
    before = len(ends(screen))
    one = sa.single_env(HEAD_ON, "robot.1", changes={"run.duration": 0.1}, render_mode="human", connect=screen.url)
    one.reset(seed=1)
    one.step(None)
    one.close()
    assert len(ends(screen)) == before + 1


WITHOUT_SCREEN = f"""if True:
    import json, os, sys
    os.environ.pop("DISPLAY", None), os.environ.pop("WAYLAND_DISPLAY", None)
    import symaware_cli as sa
    env = sa.env({str(HEAD_ON)!r}, "robot", render_mode="human")
    try:
        env.reset(seed=1)
    except Exception as error:
        print(json.dumps([type(error).__name__, str(error)]))
"""


def test_without_a_screen_the_first_episode_raises_an_error() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_SCREEN], capture_output=True, text=True, check=True)
    name, said = json.loads(done.stdout)
    assert name == "ViewerError"
    assert "no screen or graphics driver" in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"render_mode": "ansi"}, "'ansi' is neither rgb_array nor human"),
        ({"render_mode": "rgb_array", "connect": "rerun+http://127.0.0.1:9876/proxy"}, "for the render mode human"),
    ],
)
def test_an_unknown_mode_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        head_on(**options)


def test_a_missing_viewer_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib import metadata

    def missing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr("symaware_cli.views.viewer.metadata.version", missing)
    with pytest.raises(sa.LogError, match=r"need Rerun: pip install 'symaware-cli\[viewer\]'"):
        head_on(render_mode="human")
