"""The agents' bodies where they truly are, tinted by risk; their headings, labels and trails."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.rotation import rotated
from symaware_cli.viewing.chunk import Chunk, Frames, SeriesFrames
from symaware_cli.viewing.detail import FEW, Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.outline import outlines
from symaware_cli.viewing.palette import faded, tinted
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]
Colours = NDArray[np.uint8]

#: How often a trail has a point [ns], for those of all and those of a crowd.
_TRAIL_STEP = 100_000_000
#: How far above the ground rings lie at least, so that they are seen [m].
_ABOVE = 5e-3
_HEADING: Colours = np.array((240, 240, 240), np.uint8)


class Bodies(Drawing):
    """Every agent in its shape."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        self._risk: dict[str, Array] = {}
        self._shown: set[str] = set()

    def begin(self) -> None:
        """Put up sizes and labels, which do not change."""
        import rerun as rr

        for group_view in self.run_view.group_views.values():
            path = f"world/agents/{group_view.name}"
            look = self._look(group_view)
            if look is not None:
                self.output.static(f"{path}/body", look)
            self.output.static(f"{path}/heading", rr.LineStrips3D.from_fields(radii=self._width(group_view, 0.12, 2.0)))
            named = self._named(group_view)
            labels = rr.Points3D.from_fields(
                labels=[self._label(group_view, row) for row in named],
                show_labels=True,
                radii=rr.Radius.ui_points([0.0]),
            )
            self.output.static(f"{path}/label", labels)

    def _look(self, group_view: GroupView) -> Any:
        """What of the bodies does not change; None if nothing does."""
        import rerun as rr

        shape = group_view.shape
        match self._kind(group_view):
            case "ring":
                thick = rr.Radius.ui_points([1.5])
                return rr.Cylinders3D.from_fields(lengths=[0.0], line_radii=thick, fill_mode="majorwireframe")
            case "cylinder":
                assert shape
                assert shape.cylinder
                return rr.Cylinders3D.from_fields(lengths=[shape.cylinder.height], fill_mode="solid")
            case "box":
                assert shape
                assert shape.box
                height = 0.5 * shape.box.upright if self.run_view.is_spatial else 0.01
                half = [0.5 * shape.box.length, 0.5 * shape.box.width, height]
                return rr.Boxes3D.from_fields(half_sizes=[half] * len(group_view.agents), fill_mode="solid")
            case "ball":
                # Points without a size are so many pixels wide.
                return rr.Points3D.from_fields(radii=[shape.radius] if shape else rr.Radius.ui_points([4.0]))
        return None

    def _kind(self, group_view: GroupView) -> Literal["ring", "cylinder", "box", "outline", "ball"]:
        """How bodies are drawn. A ring goes around those of whom more is known, to show who they are and their risk."""
        shape = group_view.shape
        if group_view.figure:
            return "ring"
        if shape and shape.box:
            return "box"
        if shape and shape.polygon:
            return "outline"
        return "cylinder" if shape and shape.cylinder and self.run_view.is_spatial else "ball"

    def draw(self, chunk: Chunk) -> None:
        """Draw where everybody is."""
        for group_view in self.run_view.group_views.values():
            frames = chunk.frames.get(group_view.whereabouts)
            times = frames.times if frames else np.empty(0, np.int64)
            if group_view.name not in self._shown:
                self._shown.add(group_view.name)
                if not len(times) or times[0] > chunk.start:
                    self._hide(group_view, chunk.start)
            shares = self._shares(group_view, times, chunk.strips.get(f"/agents/{group_view.name}/risk"))
            if frames and len(times):
                positions, orientations = self.postures(group_view, times, chunk)
                self._draw(group_view, times, positions, orientations, tinted(group_view.colours, shares))
                headings = group_view.headings(frames.values)
                if headings is not None and group_view.radius and not group_view.figure and self.detail.minds:
                    self._draw_headings(group_view, times, positions, headings)

    def _hide(self, group_view: GroupView, time: int) -> None:
        """Put bodies nowhere that are not there yet: what has a size and no place would be shown at the origin."""
        nowhere = np.full((1, len(group_view.agents), 7), np.nan)
        self._draw(group_view, np.array([time]), nowhere[..., :3], nowhere[..., 3:], group_view.colours[None])

    def _draw(
        self, group_view: GroupView, times: NDArray[np.int64], positions: Array, orientations: Array, colours: Colours
    ) -> None:
        path, shape, count = f"world/agents/{group_view.name}", group_view.shape, positions.shape[1]
        middles = positions
        match self._kind(group_view):
            case "ring":
                assert group_view.figure
                middles = positions + rotated(orientations, group_view.figure.middle)
                if self.run_view.ground is not None:
                    middles[..., 2] = np.maximum(middles[..., 2], self.run_view.ground + _ABOVE)
                self._draw_rings(f"{path}/body", times, middles, group_view.extent, colours)
            case "cylinder":
                assert shape
                self._draw_rings(f"{path}/body", times, positions, shape.radius, colours)
            case "box":
                self.output.boxes(f"{path}/body", times, positions, orientations, colours)
            case "outline":
                assert shape
                outline = np.pad(_closed(outlines(shape)[0]), ((0, 0), (0, 1)))
                corners = positions[..., None, :] + rotated(orientations[..., None, :], outline)
                lengths = np.full(len(times) * count, len(outline))
                counts = [count] * len(times)
                flat = colours.reshape(-1, 3)
                self.output.strips(f"{path}/body", times, corners.reshape(-1, 3), lengths, counts, flat)
            case "ball":
                self.output.points(f"{path}/body", times, positions, colours)
        named = self._named(group_view)
        if named:
            # Below the bodies as the view shows them, so that it hides none.
            below = np.array(
                [0.0, 0.0, -group_view.extent] if self.run_view.is_spatial else [0.0, -group_view.extent, 0.0]
            )
            shades = np.broadcast_to(group_view.colours[named], (len(times), len(named), 3))
            self.output.points(f"{path}/label", times, middles[:, named] + below, shades)

    def _draw_rings(self, path: str, times: NDArray[np.int64], centres: Array, radius: float, colours: Colours) -> None:
        count = centres.shape[1]
        self.output.rings(path, times, centres, np.full(len(times) * count, radius), [count] * len(times), colours)

    def _draw_headings(
        self, group_view: GroupView, times: NDArray[np.int64], positions: Array, headings: Array
    ) -> None:
        """Draw a line from each rim outward, where somebody faces."""
        facing = np.stack([np.cos(headings), np.sin(headings), np.zeros_like(headings)], axis=-1)
        # Just above the body, which would hide it from above.
        above = np.array([0.0, 0.0, self._top(group_view) + 0.05 * group_view.radius])
        inner, outer = positions + above, positions + above + 1.5 * group_view.radius * facing
        self.output.segments(
            f"world/agents/{group_view.name}/heading", times, np.stack([inner, outer], axis=2), _HEADING
        )

    def _top(self, group_view: GroupView) -> float:
        """How far bodies reach up [m]."""
        shape = group_view.shape
        if shape is None or not self.run_view.is_spatial or not (shape.box or shape.cylinder):
            return group_view.radius
        return 0.5 * (shape.box.upright if shape.box else shape.cylinder.height if shape.cylinder else 0.0)

    def _named(self, group_view: GroupView) -> list[int]:
        """The rows of those who have a label."""
        everybody = range(len(group_view.agents))
        return [row for row in everybody if self.detail.labels or group_view.agents[row] in self.detail.focus]

    def _label(self, group_view: GroupView, row: int) -> str:
        """An agent's id, or what tells it from the others where there is one group only."""
        id, prefix = group_view.agents[row], f"{group_view.name}."
        return id.removeprefix(prefix) if len(self.run_view.group_views) == 1 else id

    def _width(self, group_view: GroupView, share: float, pixels: float) -> Any:
        import rerun as rr

        return [share * group_view.radius] if group_view.radius else rr.Radius.ui_points([pixels])

    def _shares(self, group_view: GroupView, times: NDArray[np.int64], strips: SeriesFrames | None) -> Array:
        """How red each agent is at some instants of a chunk; (len(times), n)."""
        before = self._risk.get(group_view.name, np.full((len(group_view.agents), 1), np.nan))
        if strips is None or not strips.values.shape[1]:
            return np.broadcast_to(before[:, 0], (len(times), len(before)))
        risk = Frames(strips.times, strips.firsts[..., :1], before)
        self._risk[group_view.name] = risk.values[-1]
        return risk.at(times)[..., 0]


class Trails(Drawing):
    """Where everybody came from: a piece of line for each moment, of which the view shows the last ones."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        self._last: dict[str, tuple[int, Array]] = {}

    def begin(self) -> None:
        """Put up how thick they are."""
        import rerun as rr

        for group_view in self.run_view.group_views.values():
            pixels = 1.5 if self.detail.minds else 1.0
            self.output.static(
                f"world/agents/{group_view.name}/trail",
                rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([pixels])),
            )

    def draw(self, chunk: Chunk) -> None:
        """Draw the ways between the moments."""
        step = _TRAIL_STEP if self.detail.minds else 3 * _TRAIL_STEP
        for group_view in self.run_view.group_views.values():
            frames = chunk.frames.get(group_view.whereabouts)
            if not frames:
                continue
            last = self._last.get(group_view.name)
            chosen = _spaced(frames.times, step, last[0] if last else None)
            if not len(chosen):
                continue
            times, places = frames.times[chosen], group_view.positions(frames.values[chosen])
            before = places[:1] if last is None else last[1][None]
            starts = np.concatenate([before, places[:-1]])
            self._last[group_view.name] = int(times[-1]), places[-1]
            shades = faded(group_view.colours, 0.45 if self.run_view.agent_count <= FEW else 0.65)
            ways = np.stack([starts, places], axis=2)
            self.output.segments(f"world/agents/{group_view.name}/trail", times, ways, shades)


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
