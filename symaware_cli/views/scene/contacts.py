"""Contacts: a ring that flashes at the beginning and follows the bodies during a contact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import logged_events
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.outline import circle
from symaware_cli.views.palette import CONTACT, Colour
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Lines, Modes, Points
from symaware_cli.views.views import RunView, in_space

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: Radius of a ring at times after its beginning [ns], in radii of the smaller body.
_FLASH_TIMES = np.array([0, 80_000_000, 160_000_000, 240_000_000], np.int64)
_FLASH_SIZES = np.array([2.4, 2.0, 1.6, 1.3])
_RING = in_space(circle(corners=24))
#: Size of a contact of bodies without a size [m].
_POINT = 0.2


@dataclass(frozen=True)
class _Touch:
    """A contact between two bodies.

    Attributes:
        pair: The two bodies.
        point: The point where it began (3,) [m]; None if unknown.
        since: When it began [ns].
        until: When it ended [ns]; None if it has not yet.
        flashes: Whether its beginning flashes: that of an interrupted contact does not.
    """

    pair: tuple[str, str]
    point: Array | None
    since: int
    until: int | None = None
    flashes: bool = True


class Contacts(Drawing):
    """Draws all contacts between agents, and between agents and entities of the environment."""

    order: ClassVar = 180

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        #: The contacts at the end of the last chunk, each with its offset from the middle of the two bodies (3,).
        self._touching: dict[tuple[str, str], tuple[_Touch, Array]] = {}
        #: The last instant up to which rings have been drawn [ns].
        self._drawn = -1

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the rings of all contacts."""
        entries = [logged_events.contact(time, message) for time, message in chunk.entries.get("/contacts", ())]
        touches = self._touches(entries, chunk)
        drawn, self._drawn = self._drawn, chunk.end
        if not touches:
            return
        begun = np.array([touch.since for touch, _ in touches])
        ended = np.array([touch.until for touch, _ in touches if touch.until is not None], np.int64)
        moving = [frames.times for topic, frames in chunk.frames.items() if topic.startswith("/world/")]
        moments = np.unique(np.concatenate([(begun[:, None] + _FLASH_TIMES).ravel(), ended, *moving]))
        moments = moments[(moments > max(drawn, begun.min() - 1)) & (moments <= chunk.end)]
        instants, rings = [np.empty(0, np.intp)], [np.empty((0, *_RING.shape))]
        for touch, offset in touches:
            last = chunk.end + 1 if touch.until is None else touch.until
            present = np.flatnonzero((moments >= touch.since) & (moments < last))
            centres = self._middle(touch.pair, moments[present], chunk) + offset
            size = self._size(touch.pair)
            flash = np.searchsorted(_FLASH_TIMES, moments[present] - touch.since, side="right") - 1
            if not touch.flashes:
                flash[:] = len(_FLASH_SIZES) - 1
            instants.append(present)
            # Just above the bodies, which would hide it.
            rings.append(
                centres[:, None] + np.array([0.0, 0.0, 1.2 * size]) + size * _FLASH_SIZES[flash, None, None] * _RING
            )
        which, all_rings = np.concatenate(instants), np.concatenate(rings)
        counts = np.bincount(which, minlength=len(moments))
        # When the last contact ends, an instant without rings must be drawn.
        said = (counts > 0) | (np.concatenate([[len(_RING)], counts[:-1]]) > 0)
        order = np.argsort(which, kind="stable")
        yield Lines(
            path="world/contacts",
            layer="contacts",
            times=moments[said],
            counts=counts[said],
            points=all_rings[order].reshape(-1, 3),
            lengths=np.full(len(which), len(_RING)),
            colours=CONTACT,
            width=2.5,
            names=[" ".join(touch.pair) for touch, _ in touches],
            who=np.repeat(np.arange(len(touches)), [len(each) for each in rings[1:]])[order],
        )

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "red rings", "contacts"

    def _touches(self, entries: Sequence[logged_events.LoggedContact], chunk: Chunk) -> list[tuple[_Touch, Array]]:
        """Return all contacts during a chunk, each with its offset from the middle of the two bodies."""
        touches = []
        for entry in entries:
            pair = entry.a, entry.b
            if entry.stage != "END":
                if not all(who in self.run_view.place or who in self.run_view.obstacle_views for who in pair):
                    # The ground, with which all bodies are in contact.
                    continue
                point = in_space(np.array(entry.point)) if len(entry.point) in (2, 3) else None
                middle = self._middle(pair, np.array([entry.time]), chunk)[0]
                offset = np.zeros(3) if point is None else point - middle
                if np.isfinite(offset + middle).all():
                    self._touching[pair] = (
                        _Touch(pair, point, entry.time, flashes=entry.stage == "BEGIN"),
                        offset,
                    )
            elif pair in self._touching:
                touch, offset = self._touching.pop(pair)
                touches.append((replace(touch, until=entry.time), offset))
        return [*touches, *self._touching.values()]

    def _middle(self, pair: tuple[str, str], times: Times, chunk: Chunk) -> Array:
        """Return the middle of the two bodies, or the position of the agent if only one is; (len(times), 3) [m]."""
        agents = [who for who in pair if who in self.run_view.place] or list(pair)
        middle: Array = np.mean([self.places(who, times, chunk) for who in agents], axis=0)
        return middle

    def _size(self, pair: Sequence[str]) -> float:
        radii = [
            self.run_view.group_views[self.run_view.place[who][0]].extent for who in pair if who in self.run_view.place
        ]
        return min(radii, default=0.0) or _POINT


#: The modes of a pair of bodies, with their tints.
_APART, _TOUCHING = "apart", "in contact"
_TINTS: dict[str, Colour] = {_APART: (232, 235, 240), _TOUCHING: CONTACT}


class ContactStrips(Drawing):
    """Draws for each pair of bodies that meet when they were in contact."""

    outputs: ClassVar = frozenset({"plot"})
    order: ClassVar = 285

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._start: int | None = None
        self._met: set[tuple[str, str]] = set()

    def marks(self, chunk: Chunk) -> Iterator[Modes]:
        """Yield the beginnings and ends of contacts, apart from those with the ground."""
        self._start = chunk.start if self._start is None else self._start
        changes: dict[tuple[str, str], list[tuple[int, str]]] = {}
        for time, message in chunk.entries.get("/contacts", ()):
            entry = logged_events.contact(time, message)
            pair = entry.a, entry.b
            if all(who in self.run_view.place or who in self.run_view.obstacle_views for who in pair):
                changes.setdefault(pair, []).append((entry.time, _APART if entry.stage == "END" else _TOUCHING))
        for pair, found in changes.items():
            if pair not in self._met:
                self._met.add(pair)
                found.insert(0, (self._start, _APART))
            times = np.array([time for time, _ in found], np.int64)
            yield Modes(path=f"contacts/{' '.join(pair)}", times=times, modes=[mode for _, mode in found], tints=_TINTS)


def contact_time(mark: Modes, end: int) -> int:
    """Return for how long a pair was in contact up to an instant [ns]."""
    spans = zip(mark.times.tolist(), [*mark.times[1:].tolist(), end], mark.modes, strict=True)
    return sum(max(last - first, 0) for first, last, mode in spans if mode == _TOUCHING)


class ContactPoints(Drawing):
    """Draws a point where each contact began."""

    outputs: ClassVar = frozenset({"plot"})
    order: ClassVar = 280

    def marks(self, chunk: Chunk) -> Iterator[Points]:
        """Yield the contacts that begin in a chunk; positions are NaN where unknown."""
        entries = [logged_events.contact(time, message) for time, message in chunk.entries.get("/contacts", ())]
        begun = [entry for entry in entries if entry.stage == "BEGIN"]
        if begun:
            nowhere = np.full(3, np.nan)
            yield Points(
                path="world/contacts/points",
                layer="contacts",
                times=np.array([entry.time for entry in begun], np.int64),
                counts=np.ones(len(begun), np.int64),
                positions=np.array([in_space(np.array(entry.point)) if entry.point else nowhere for entry in begun]),
                colours=CONTACT,
                size=6.0,
                names=[f"{entry.a} {entry.b}" for entry in begun],
                who=np.arange(len(begun)),
            )
