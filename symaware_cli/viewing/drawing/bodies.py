"""The agents' bodies where they truly are, tinted by risk; their headings, labels and trails."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.cast import Cast, Troupe
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt, Frames, Strips
from symaware_cli.viewing.outline import outlines, placed
from symaware_cli.viewing.palette import faded, tinted
from symaware_cli.viewing.stage import Stage

Array = NDArray[np.float64]
Colours = NDArray[np.uint8]

#: How often a trail has a point [ns], for those of all and those of a crowd.
_TRAIL_STEP = 100_000_000
_HEADING: Colours = np.array((240, 240, 240), np.uint8)


class Bodies(Drawing):
    """Every agent in its shape."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        self._risk: dict[str, Array] = {}

    def begin(self) -> None:
        """Put up sizes and labels, which do not change."""
        import rerun as rr

        for troupe in self.cast.troupes.values():
            path, shape = f"world/{troupe.name}", troupe.shape
            if shape is None or shape.circle:
                # Points without a size are so many pixels wide.
                radii = [shape.circle.radius] if shape and shape.circle else rr.Radius.ui_points([4.0])
                self.stage.static(f"{path}/body", rr.Points3D.from_fields(radii=radii))
            elif shape.box:
                height = shape.box.height or min(shape.box.length, shape.box.width)
                half = [0.5 * shape.box.length, 0.5 * shape.box.width, 0.5 * height if self.cast.is_spatial else 0.01]
                self.stage.static(
                    f"{path}/body", rr.Boxes3D.from_fields(half_sizes=[half] * len(troupe.agents), fill_mode="solid")
                )
            self.stage.static(f"{path}/heading", rr.LineStrips3D.from_fields(radii=self._width(troupe, 0.12, 2.0)))
            named = self._named(troupe)
            labels = rr.Points3D.from_fields(
                labels=[self._label(troupe, row) for row in named], show_labels=True, radii=rr.Radius.ui_points([0.0])
            )
            self.stage.static(f"{path}/label", labels)

    def draw(self, excerpt: Excerpt) -> None:
        """Draw where everybody is."""
        for troupe in self.cast.troupes.values():
            risk = self._risk_of(troupe, excerpt.strips.get(f"/agents/{troupe.name}/risk"))
            frames = excerpt.frames.get(f"/world/{troupe.name}/state")
            if frames is not None:
                self._draw(troupe, frames, risk)

    def _draw(self, troupe: Troupe, frames: Frames, risk: Frames | None) -> None:
        path, shape, times = f"world/{troupe.name}", troupe.shape, frames.times
        positions, headings = troupe.positions(frames.values), troupe.headings(frames.values)
        known = risk.at(times) if risk else None
        shares = np.zeros(positions.shape[:2]) if known is None else known[..., 0]
        colours = tinted(troupe.colours, shares)
        still = np.zeros(positions.shape[:2]) if headings is None else headings
        if shape is not None and shape.box:
            self.stage.boxes(f"{path}/body", times, positions, still, colours)
        elif shape is not None and shape.polygon:
            corners = placed(_closed(outlines(shape)[0]), positions, still)
            lengths = np.full(corners.shape[0] * corners.shape[1], corners.shape[2])
            counts = [corners.shape[1]] * len(times)
            self.stage.strips(f"{path}/body", times, corners.reshape(-1, 3), lengths, counts, colours.reshape(-1, 3))
        else:
            self.stage.points(f"{path}/body", times, positions, colours)
        if headings is not None and troupe.radius and self.detail.minds:
            self._draw_headings(troupe, times, positions, headings)
        named = self._named(troupe)
        if named:
            self.stage.points(
                f"{path}/label",
                times,
                positions[:, named],
                np.broadcast_to(troupe.colours[named], (len(times), len(named), 3)),
            )

    def _draw_headings(self, troupe: Troupe, times: NDArray[np.int64], positions: Array, headings: Array) -> None:
        """Draw a line from each rim outward, where somebody faces."""
        facing = np.stack([np.cos(headings), np.sin(headings), np.zeros_like(headings)], axis=-1)
        # Just above the body, which would hide it from above.
        above = np.array([0.0, 0.0, 1.05 * troupe.radius])
        inner, outer = positions + above, positions + above + 1.5 * troupe.radius * facing
        points = np.stack([inner, outer], axis=2)
        count = points.shape[0] * points.shape[1]
        colours = np.broadcast_to(_HEADING, (count, 3))
        self.stage.strips(
            f"world/{troupe.name}/heading",
            times,
            points.reshape(-1, 3),
            np.full(count, 2),
            [points.shape[1]] * len(times),
            colours,
        )

    def _named(self, troupe: Troupe) -> list[int]:
        """The rows of those who have a label."""
        everybody = range(len(troupe.agents))
        return [row for row in everybody if self.detail.labels or troupe.agents[row] in self.detail.focus]

    def _label(self, troupe: Troupe, row: int) -> str:
        """An agent's id, or what tells it from the others where there is one group only."""
        id, prefix = troupe.agents[row], f"{troupe.name}."
        return id.removeprefix(prefix) if len(self.cast.troupes) == 1 else id

    def _width(self, troupe: Troupe, share: float, pixels: float) -> Any:
        import rerun as rr

        return [share * troupe.radius] if troupe.radius else rr.Radius.ui_points([pixels])

    def _risk_of(self, troupe: Troupe, strips: Strips | None) -> Frames | None:
        """The risk of each agent over an excerpt; what was known last, where nothing is new."""
        before = self._risk.get(troupe.name)
        if strips is None:
            if before is None:
                return None
            return Frames(np.empty(0, np.int64), np.empty((0, *before.shape)), before)
        values = strips.firsts()[..., :1]
        self._risk[troupe.name] = values[-1]
        return Frames(strips.times, values, before)


class Trails(Drawing):
    """Where everybody came from: a piece of line for each moment, of which the view shows the last ones."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        self._last: dict[str, tuple[int, Array]] = {}

    def begin(self) -> None:
        """Put up how thick they are."""
        import rerun as rr

        for troupe in self.cast.troupes.values():
            pixels = 1.5 if self.detail.minds else 1.0
            self.stage.static(
                f"world/{troupe.name}/trail", rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([pixels]))
            )

    def draw(self, excerpt: Excerpt) -> None:
        """Draw the ways between the moments."""
        step = _TRAIL_STEP if self.detail.minds else 3 * _TRAIL_STEP
        for troupe in self.cast.troupes.values():
            frames = excerpt.frames.get(f"/world/{troupe.name}/state")
            if frames is None:
                continue
            last = self._last.get(troupe.name)
            chosen = _spaced(frames.times, step, last[0] if last else None)
            if not len(chosen):
                continue
            times, places = frames.times[chosen], troupe.positions(frames.values[chosen])
            before = places[:1] if last is None else last[1][None]
            starts = np.concatenate([before, places[:-1]])
            self._last[troupe.name] = int(times[-1]), places[-1]
            segments = np.stack([starts, places], axis=2)
            count = segments.shape[0] * segments.shape[1]
            colours = np.broadcast_to(faded(troupe.colours, 0.45), (len(times), *troupe.colours.shape))
            self.stage.strips(
                f"world/{troupe.name}/trail",
                times,
                segments.reshape(-1, 3),
                np.full(count, 2),
                [segments.shape[1]] * len(times),
                colours.reshape(-1, 3),
            )


def _spaced(times: NDArray[np.int64], step: int, last: int | None) -> NDArray[np.intp]:
    """Which of some times to take so that they are at least a step apart."""
    chosen = []
    for place, time in enumerate(times.tolist()):
        if last is None or time - last >= step:
            chosen.append(place)
            last = time
    return np.array(chosen, np.intp)


def _closed(outline: Array) -> Array:
    return np.concatenate([outline, outline[:1]])
