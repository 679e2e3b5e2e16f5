"""Videos of replays: the frames of a run at some speed and from a viewpoint.

Reasons: docs/decisions/0104-videos-are-drawn-from-marks.md
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import LogError, whole_file
from symaware_cli.views.palette import (
    AGENTS,
    CONTACT,
    LIGHT,
    MESSAGE,
    MOVABLE,
    REGIONS,
    RISK,
    SCENERY,
    Colour,
    ReplayTheme,
)
from symaware_cli.views.plotting.plot import matplotlib_required
from symaware_cli.views.video.video_file import RATE, check_video, write_video
from symaware_cli.views.video.viewpoint import VIEWPOINTS, Viewpoint

if TYPE_CHECKING:
    from symaware_cli.views.replay_session import ReplaySession

#: Maximum duration of a video without a given speed [s].
_USUAL = 20.0

#: Maximum number of frames.
_FRAMES = 6_000


@dataclass(frozen=True)
class VideoRequest:
    """A request for a video.

    Attributes:
        speed: Simulated seconds per second; None for real time, or faster where that would take more than 20 s.
        size: Width and height [pixels].
        view: The name of a viewpoint; empty for a view from above of a planar world, and at an angle of a spatial one.
        theme: The colours around the agents.
    """

    speed: float | None = None
    size: tuple[int, int] = (800, 600)
    view: str = ""
    theme: ReplayTheme = LIGHT


@dataclass(frozen=True)
class Film:
    """The instants and the speed of a video.

    Attributes:
        moments: The instants of its frames [ns].
        speed: Simulated seconds per second.
    """

    moments: NDArray[np.int64]
    speed: float

    @property
    def words(self) -> str:
        """A description for users."""
        return f"{len(self.moments):,} frames, {len(self.moments) / RATE:.3g} s at {self.speed:.3g} times real time"


def film_of(start: int, end: int, speed: float | None) -> Film:
    """Choose the instants of a video from one instant to another [ns].

    Raises:
        LogError: There would be too many frames.
    """
    duration = (end - start) / 1e9
    chosen = max(1.0, duration / _USUAL) if speed is None else speed
    count = int(duration / chosen * RATE) + 1
    if count > _FRAMES:
        least = duration * RATE / (_FRAMES - 1)
        raise LogError(f"the video would have {count:,} frames; take --speed {least:.3g} or more, or --from and --to")
    moments = start + np.round(np.arange(count) * (chosen / RATE * 1e9)).astype(np.int64)
    return Film(np.minimum(moments, end), chosen)


def write_replay(
    session: ReplaySession, path: Path, request: VideoRequest, on_progress: Callable[[int], None] | None = None
) -> Film:
    """Write a video of a replay, which appears whole or not at all; the same log and versions give the same bytes.

    Args:
        session: The replay to show.
        path: The file; its suffix determines the format.
        request: Speed, size, viewpoint and colours.
        on_progress: Called with the simulated time of each frame [ns].

    Raises:
        LogError: The format is unknown or needs a program, there would be too many frames, or matplotlib is missing.
        OutputError: The file cannot be written.
    """
    check_video(path)
    film = film_of(*session.span, request.speed)
    name = request.view or ("angle" if session.run_view.is_spatial else "above")
    with matplotlib_required():
        frames = _frames(session, film, VIEWPOINTS[name], request, on_progress)
    with whole_file(path, session.log.path) as partial:
        write_video(partial, path.suffix.lower(), frames, _colours(session, request.theme))
    return film


def _frames(
    session: ReplaySession,
    film: Film,
    viewpoint: Viewpoint,
    request: VideoRequest,
    on_progress: Callable[[int], None] | None,
) -> Iterator[NDArray[np.uint8]]:
    """Return an iterator over the frames."""
    from symaware_cli.views.video.frame_painter import FramePainter

    content = session.content
    painter = FramePainter(
        (content.low, content.high),
        viewpoint,
        request.theme,
        request.size,
        f"{session.run_view.name}, seed {session.run_view.seed}",
        session.detail.trail,
        session.span,
    )

    def drawn() -> Iterator[NDArray[np.uint8]]:
        moments, taken = film.moments.tolist(), 0
        for end, shown in session.marks_by_chunk():
            for mark in shown:
                painter.take(mark)
            while taken < len(moments) and moments[taken] <= end:
                yield painter.frame(moments[taken])
                if on_progress:
                    on_progress(moments[taken])
                taken += 1
        for moment in moments[taken:]:
            yield painter.frame(moment)

    return drawn()


def _colours(session: ReplaySession, theme: ReplayTheme) -> list[Colour]:
    """Return the colours that occur, the background first."""
    named = [theme.background, theme.ink, RISK, SCENERY, MOVABLE, CONTACT, MESSAGE, theme.faint]
    found = [*named, *AGENTS, *REGIONS]
    for group_view in session.run_view.group_views.values():
        found += [(int(red), int(green), int(blue)) for red, green, blue in np.unique(group_view.colours, axis=0)]
    return list(dict.fromkeys(found))
