"""Videos of replays: drawn without a screen, with the same bytes each time, and with the expected frames."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from plot_logs import YARD, log_of
from rerun_files import STEP, Script, group
from simulating import untyped

from symaware_cli.log import LogError, UnknownNameError, wire
from symaware_cli.views.label_layout import labels_beside
from symaware_cli.views.palette import AGENTS, DARK, LIGHT
from symaware_cli.views.replay_session import ReplaySession, replay_session
from symaware_cli.views.video.video import VideoRequest, film_of, write_replay
from symaware_cli.views.video.video_file import check_video
from symaware_cli.views.video.viewpoint import VIEWPOINTS

SECOND = 1_000_000_000
SMALL = (200, 200)


@pytest.fixture
def walk(tmp_path: Path) -> ReplaySession:
    """One agent that goes from the left to the right in a second."""
    script = Script(tmp_path / "a.mcap", {"a": group("a", shape={"circle": {"radius": 0.5}})})
    for step in range(11):
        script.say("/world/a/state", step * STEP, wire.encode_rows([[float(step), 0.0]]), "Rows")
    return replay_session(script.finish())


def test_a_video_has_a_frame_every_50_ms(walk: ReplaySession, tmp_path: Path) -> None:
    film = write_replay(walk, tmp_path / "a.gif", VideoRequest(speed=0.5 * STEP * 10 / SECOND, size=SMALL))
    with Image.open(tmp_path / "a.gif") as image:
        assert untyped(image).n_frames == len(film.moments) == 41
        assert image.info["duration"] == 50
        assert image.size == SMALL


def test_a_body_is_where_it_is_at_the_time_of_the_frame(walk: ReplaySession, tmp_path: Path) -> None:
    write_replay(walk, tmp_path / "a.gif", VideoRequest(speed=1.0, size=SMALL))
    with Image.open(tmp_path / "a.gif") as image:
        places = []
        for frame in (0, untyped(image).n_frames - 1):
            image.seek(frame)
            shade = np.abs(np.array(image.convert("RGB"), int) - AGENTS[0]).max(axis=2)
            places.append(np.argwhere(shade < 12).mean(axis=0))
    (_, first), (_, last) = places
    assert first < 0.3 * SMALL[0]
    assert last > 0.7 * SMALL[0]


def test_the_same_log_gives_the_same_bytes(walk: ReplaySession, tmp_path: Path) -> None:
    for name in ("a.gif", "b.gif"):
        write_replay(walk, tmp_path / name, VideoRequest(speed=4.0, size=SMALL))
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_a_theme_is_the_colour_behind_everything(walk: ReplaySession, tmp_path: Path) -> None:
    for theme in (LIGHT, DARK):
        write_replay(walk, tmp_path / "a.gif", VideoRequest(speed=10.0, size=SMALL, theme=theme))
        with Image.open(tmp_path / "a.gif") as image:
            shade = np.array(image.convert("RGB"), int)[60, 100]
        assert np.abs(shade - theme.background).max() <= 2  # Pillow chooses a colour near it


def test_walls_regions_and_verdicts_of_a_scenario_are_drawn_from_every_viewpoint(tmp_path: Path) -> None:
    session = replay_session(log_of(tmp_path, YARD))
    shown = set()
    for view in VIEWPOINTS:
        write_replay(session, tmp_path / f"{view}.gif", VideoRequest(speed=1e3, size=SMALL, view=view))
        shown.add((tmp_path / f"{view}.gif").read_bytes())
    assert len(shown) == len(VIEWPOINTS)


def test_a_video_lasts_twenty_seconds_at_most_unless_a_speed_is_given() -> None:
    assert film_of(0, 10 * SECOND, None).speed == 1.0
    long = film_of(0, 60 * SECOND, None)
    assert (long.speed, len(long.moments)) == (3.0, 401)
    with pytest.raises(LogError, match="--speed"):
        film_of(0, 3600 * SECOND, 1.0)


def test_an_unknown_format_is_reported_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"use \.gif, \.webp or \.mp4"):
        check_video(Path("a.avi"))


def test_mp4_without_its_program_is_refused_with_an_alternative(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(LogError, match=r"`ffmpeg`, which is not installed; \.gif needs none"):
        check_video(Path("a.mp4"))


def test_labels_cover_neither_bodies_nor_each_other() -> None:
    generator = np.random.default_rng(3)
    centres, extents = generator.uniform(0.0, 12.0, (4, 9, 2)), np.full(9, 0.5)
    sizes = np.tile([1.2, 0.5], (9, 1))
    places, chosen = labels_beside(centres, extents, list(range(9)), sizes)
    known = np.flatnonzero(chosen >= 0)
    assert len(known) > 3
    for label in known.tolist():
        apart = np.maximum(np.abs(centres - places[:, label][:, None]) - 0.5 * sizes[label], 0.0)
        assert (np.linalg.norm(apart, axis=2) > 0.9 * extents).all()
        for other in known[known < label].tolist():
            assert (np.abs(places[:, label] - places[:, other]) >= sizes[label] - 1e-9).any(axis=1).all()


def test_a_label_stays_on_its_side_while_it_can() -> None:
    centres, extents, sizes = np.array([[[0.0, 0.0], [0.0, -1.2]]]), np.array([0.5, 0.5]), np.array([[0.6, 0.4]])
    _, first = labels_beside(centres, extents, [0], sizes)
    _, then = labels_beside(np.array([[[0.0, 0.0], [0.0, -9.0]]]), extents, [0], sizes, first)
    assert first[0] != 0
    assert then[0] == first[0]
