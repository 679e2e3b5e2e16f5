"""Marks: what is to be seen, as arrays. Whose it is, and what it means, is known only to whoever makes them.

A mark is up at its path from each of its instants until the next, and replaces what was there. Backends show marks, and
leave out kinds that they have no means for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core import Shape
from symaware_cli.viewing.figure import Figure
from symaware_cli.viewing.outline import Piece, outlines

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Integers = NDArray[np.integer]
Colours = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class _Mark:
    """What all marks have; in what follows k is a number of instants.

    Attributes:
        path: What it is called, such as ``minds/robot/intent``; unique, and what views are composed of.
        times: (k,) ascending [ns].
        layer: What is switched on and off together, where a backend has layers; the path if empty.
    """

    path: str
    times: Times
    layer: str = ""


@dataclass(frozen=True, kw_only=True)
class _Items(_Mark):
    """Things of which each instant has a number of its own.

    Attributes:
        counts: (k,) how many of the m things belong to each instant.
        colours: (m, 3), or one for all (3,).
        transparency: How much of the background shines through, from 0 to 1; (m,), or one for all.
        names: What things can be told apart by.
        who: (m,) the name of each, by index; None where they have none.
    """

    counts: ArrayLike
    colours: ArrayLike
    transparency: ArrayLike = 0.0
    names: Sequence[str] = ()
    who: Integers | None = None


@dataclass(frozen=True, kw_only=True)
class Lines(_Items):
    """Lines through points.

    Attributes:
        points: (sum of lengths, 3) [m].
        lengths: (m,) points of each line.
        width: How thick they are [pixels].
        thickness: The same [m]; 0 for `width`.
        fades: Whether each grows fainter from its beginning to its end.
        lasting: How long each stays up, whatever comes after [s]; 0 for until the next instant.
        begins: (m,) whether a line is new at its instant, rather than one that was there before and has moved. Only new
            ones are shown, for `lasting`, by a backend with lifetimes. None if lines are not told apart like this.
    """

    points: Array
    lengths: ArrayLike
    width: float = 1.5
    thickness: float = 0.0
    fades: bool = False
    lasting: float = 0.0
    begins: NDArray[np.bool_] | None = None


@dataclass(frozen=True, kw_only=True)
class Points(_Items):
    """Dots.

    Attributes:
        positions: (m, 3) [m]; those that are not finite are not shown.
        size: How large they are [pixels].
    """

    positions: Array
    size: float


@dataclass(frozen=True, kw_only=True)
class Crosses(_Items):
    """Crosses that lie level.

    Attributes:
        positions: (m, 3) of their middles [m].
        size: How far they reach along each axis [m].
        width: How thick their strokes are [pixels].
    """

    positions: Array
    size: float
    width: float = 1.5


@dataclass(frozen=True, kw_only=True)
class Rings(_Items):
    """Level circles.

    Attributes:
        centres: (m, 3) [m].
        radii: (m,) [m].
        width: How thick they are [pixels].
    """

    centres: Array
    radii: Array
    width: float = 1.75


@dataclass(frozen=True, kw_only=True)
class Ellipsoids(_Items):
    """Ellipsoids, or ellipses where a half size is 0.

    Attributes:
        centres: (m, 3) [m].
        half_sizes: (m, 3) [m]; 0 for those that are not known.
        orientations: (m, 4) quaternions x, y, z, w.
        width: How thick their lines are [pixels].
    """

    centres: Array
    half_sizes: Array
    orientations: Array
    width: float = 0.75


@dataclass(frozen=True, kw_only=True)
class Bodies(_Mark):
    """Bodies of one shape that move.

    Attributes:
        names: (n,) what they are called, which is what a frame that moves with them is called, too.
        positions: (k, n, 3) [m]; not finite where one is nowhere.
        orientations: (k, n, 4) quaternions x, y, z, w.
        colours: (k, n, 3).
        shape: Their outline; None for points.
        labels: What stands beside each, by number.
        label_colours: (n, 3).
        nosed: Whether their x axes are shown.
        ring: Where a ring around them lies, relative to a body (3,) [m], with its radius [m], instead of a body; None
            for a body.
        floor: How low that ring is at least [m].
        extent: How far they reach from their middles [m].
        spatial: Whether the world has a third dimension, or is seen from above.
    """

    names: Sequence[str]
    positions: Array
    orientations: Array
    colours: Colours
    shape: Shape | None
    labels: Mapping[int, str]
    label_colours: Colours
    nosed: bool
    ring: tuple[Array, float] | None
    floor: float
    extent: float
    spatial: bool


@dataclass(frozen=True, kw_only=True)
class Solid(_Mark):
    """A body that stands upright over its outline, or an area of the ground.

    Attributes:
        name: What it is called.
        pieces: Its convex pieces, relative to its position.
        low: Where it begins, relative to its position [m].
        high: Where it ends [m]; flat if that is the same.
        colour: Red, green and blue.
        transparency: How much of the background shines through, from 0 to 1.
        faded: How much of the background of a replay is mixed into its colour, from 0 to 1.
        label: Its label.
        label_at: Where that is, relative to its position [m].
        positions: (k, 3) [m].
        orientations: (k, 4) quaternions x, y, z, w.
    """

    name: str
    pieces: Sequence[Piece]
    low: float
    high: float
    colour: Sequence[int]
    positions: Array
    orientations: Array
    transparency: float = 0.0
    faded: float = 0.0
    label: str = ""
    label_at: tuple[float, float] = (0.0, 0.0)

    @property
    def outlines(self) -> Sequence[Array]:
        """The corners of each piece, (m, 2) counter-clockwise [m]."""
        return outlines(self.pieces)


@dataclass(frozen=True, kw_only=True)
class Figures(_Mark):
    """Bodies of links and joints that look the same.

    Attributes:
        figure: What they look like.
        surfaces: The files of meshes, by name.
        colour: Of what says no colour of its own.
        owners: What the bodies belong to, and what each is called, in order.
        positions: (k, n, 3) of their bases [m].
        orientations: (k, n, 4) quaternions x, y, z, w.
        joints: (k, n, joints) positions of the joints [rad] or [m].
    """

    figure: Figure
    surfaces: Mapping[str, bytes]
    colour: Sequence[int]
    owners: Sequence[tuple[str, Sequence[str]]]
    positions: Array
    orientations: Array
    joints: Array


@dataclass(frozen=True, kw_only=True)
class Ground(_Mark):
    """A level plane.

    Attributes:
        height: [m].
    """

    height: float


@dataclass(frozen=True, kw_only=True)
class FocusPoint(_Mark):
    """A place that an eye can follow.

    Attributes:
        positions: (k, 3) [m].
        reach: The radius of a ring around it [m]; None for none.
    """

    positions: Array
    reach: float | None = None


@dataclass(frozen=True, kw_only=True)
class Rays(_Mark):
    """Where rays from a sensor ended; those of one instant may be of several sensors.

    Attributes:
        times: (k,) not descending [ns].
        names: (k,) whose sensor it is.
        colours: (k, 3).
        angles: (k,) of the rays, counter-clockwise from the heading of the sensor [rad].
        distances: (k,) how far each ray goes [m]; not finite where it ends nowhere.
        poses: (k, 4) x, y, z and heading of the sensor [m], [rad].
        size: How large a point is [pixels].
        spatial: Whether the world has a third dimension.
    """

    names: Sequence[str]
    colours: Colours
    angles: Sequence[Array]
    distances: Sequence[Array]
    poses: Array
    size: float
    spatial: bool


@dataclass(frozen=True, kw_only=True)
class Images(_Mark):
    """What a camera saw.

    Attributes:
        kind: Whether pixels are colours, or depths.
        files: (k,) PNG each.
        frame: What a frame that moves with the camera is called.
        positions: (k, 3) where the camera was [m].
        targets: (k, 3) what it looked at [m].
        fields_of_view: (k,) from the lower to the upper edge [rad].
    """

    kind: Literal["colour", "depth"]
    files: Sequence[bytes]
    frame: str
    positions: Array
    targets: Array
    fields_of_view: Array


@dataclass(frozen=True, kw_only=True)
class Curves(_Mark):
    """Numbers over time.

    Attributes:
        values: (k, m).
        names: (m,).
        colours: (m, 3); None for any.
        width: How thick they are [pixels].
        keep: Which extremes are kept where more instants than pixels are to be drawn. A mean would hide that a number
            was large for a moment.
        level: The name and the height of a level line to compare with; None for none.
    """

    values: Array
    names: Sequence[str]
    colours: ArrayLike | None = None
    width: float = 1.5
    level: tuple[str, float] | None = None
    keep: Literal["greatest", "least", "both"] = "both"


@dataclass(frozen=True, kw_only=True)
class Numbers(_Mark):
    """A table of numbers over time, for backends that let a person choose what to plot.

    Attributes:
        values: (k, n, m).
        names: (n,) of the rows.
        columns: (m,) the name and the unit of each.
        separate: Whether each instant stands by itself, so that times may repeat; otherwise values hold until the next.
    """

    values: Array
    names: Sequence[str]
    columns: Sequence[tuple[str, str]]
    separate: bool = False


@dataclass(frozen=True, kw_only=True)
class Journal(_Mark):
    """Lines of a log.

    Attributes:
        times: (k,) not descending [ns].
        kinds: (k,) what happened.
        sources: (k,) where.
        texts: (k,) in words.
        levels: (k,) DEBUG, INFO, WARNING or ERROR.
    """

    kinds: Sequence[str]
    sources: Sequence[str]
    texts: Sequence[str]
    levels: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Modes(_Mark):
    """Which mode something is in.

    Attributes:
        modes: (k,).
    """

    modes: Sequence[str]


Mark: TypeAlias = (
    Lines
    | Points
    | Crosses
    | Rings
    | Ellipsoids
    | Bodies
    | Solid
    | Figures
    | Ground
    | FocusPoint
    | Rays
    | Images
    | Curves
    | Numbers
    | Journal
    | Modes
)
"""Anything that is to be seen."""

Joinable = TypeVar("Joinable", Bodies, Solid, Curves, Numbers)


def joined(parts: Sequence[Joinable]) -> Joinable:
    """Join marks of one path, which follow each other in time, into one mark."""
    names = ["times", *(name for name in ("positions", "orientations", "values") if hasattr(parts[0], name))]
    if isinstance(parts[0], Bodies):
        names.append("colours")
    whole: Any = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(parts[0], **whole)
