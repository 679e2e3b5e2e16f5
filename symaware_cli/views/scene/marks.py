"""Marks: shapes to draw, as arrays, without reference to agents or their meaning.

A mark is shown at its path from each of its instants until the next, and replaces the previous one. Backends show
marks, and ignore kinds that they do not support.

Reasons: docs/decisions/0029-scene-of-marks.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core import Shape
from symaware_cli.views.figure import Figure
from symaware_cli.views.outline import Piece, outlines

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Integers = NDArray[np.integer]
Colours = NDArray[np.uint8]

#: Phases of an area that counts for some time.
TO_COME, ACTIVE, PAST = -1, 0, 1


@dataclass(frozen=True, kw_only=True)
class _Mark:
    """The common attributes of marks; below, k is a number of instants.

    Attributes:
        path: Its unique path, such as ``awareness/robot/intent``; views select marks by path.
        times: (k,) ascending [ns].
        layer: Marks of a layer are switched on and off together, in backends with layers; the path if empty.
    """

    path: str
    times: Times
    layer: str = ""


@dataclass(frozen=True, kw_only=True)
class _Items(_Mark):
    """A mark with a number of items at each instant.

    Attributes:
        counts: (k,) number of the m items at each instant.
        colours: (m, 3), or one for all (3,).
        transparency: From 0 (opaque) to 1; (m,), or one for all.
        names: Names of items.
        who: (m,) the index in `names` of each item; None if items have no names.
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
        lengths: (m,) number of points of each line.
        width: Width [pixels].
        thickness: Thickness [m]; 0 to use `width`.
        fades: Whether each line gets fainter from its beginning to its end.
        lasting: How long each line is shown [s]; 0 for until the next instant.
        begins: (m,) whether a line is new at its instant, rather than a moved earlier one. Backends with lifetimes show
            only new lines, for `lasting`. None if lines are not distinguished like this.
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
        size: Size [pixels].
    """

    positions: Array
    size: float


@dataclass(frozen=True, kw_only=True)
class Crosses(_Items):
    """Horizontal crosses.

    Attributes:
        positions: (m, 3) centres [m].
        size: Half extent along each axis [m].
        width: Width of the strokes [pixels].
    """

    positions: Array
    size: float
    width: float = 1.5


@dataclass(frozen=True, kw_only=True)
class Rings(_Items):
    """Horizontal circles.

    Attributes:
        centres: (m, 3) [m].
        radii: (m,) [m].
        width: Width of the lines [pixels].
    """

    centres: Array
    radii: Array
    width: float = 1.75


@dataclass(frozen=True, kw_only=True)
class Ellipsoids(_Items):
    """Ellipsoids, or ellipses where a half size is 0.

    Attributes:
        centres: (m, 3) [m].
        half_sizes: (m, 3) [m]; 0 where unknown.
        orientations: (m, 4) quaternions x, y, z, w.
        width: Width of the lines [pixels].
    """

    centres: Array
    half_sizes: Array
    orientations: Array
    width: float = 0.75


@dataclass(frozen=True, kw_only=True)
class Bodies(_Mark):
    """Moving bodies of one shape.

    Attributes:
        names: (n,) names of the bodies, and of the frames attached to them.
        positions: (k, n, 3) [m]; not finite where unknown.
        orientations: (k, n, 4) quaternions x, y, z, w.
        colours: (k, n, 3).
        shape: Their outline; None for points.
        labels: Labels beside bodies, by index.
        label_colours: (n, 3).
        nosed: Whether their x axes are shown.
        ring: Centre relative to a body (3,) [m] and radius [m] of a ring to show instead of the body; None for the
            body.
        floor: Minimum height of the ring [m].
        extent: Radius of the bodies around their centres [m].
        spatial: Whether the world is spatial rather than planar.
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
    """A body that extends upright over its outline, or an area of the ground.

    Attributes:
        name: Its name.
        pieces: Its convex pieces, relative to its position.
        low: Its lower end, relative to its position [m].
        high: Its upper end [m]; equal to `low` if flat.
        colour: Red, green and blue.
        transparency: From 0 (opaque) to 1.
        faded: Share of the background of a replay in its colour, from 0 to 1.
        phases: (k,) of an area that counts for some time: as an interrupted outline while it is to come (TO_COME),
            filled while it counts (ACTIVE), as a faint outline afterwards (PAST). None to fill it always.
        label: Its label; shown while it is filled.
        label_at: Position of the label, relative to its position [m].
        movable: Whether it is a body that others move, such as a crate that is pushed.
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
    phases: NDArray[np.int8] | None = None
    label: str = ""
    label_at: tuple[float, float] = (0.0, 0.0)
    movable: bool = False

    @property
    def outlines(self) -> Sequence[Array]:
        """The corners of each piece, (m, 2) counter-clockwise [m]."""
        return outlines(self.pieces)


@dataclass(frozen=True, kw_only=True)
class Figures(_Mark):
    """Bodies of links and joints with the same figure.

    Attributes:
        figure: Their figure.
        surfaces: The files of meshes, by name.
        colour: The colour of visuals without one.
        owners: The groups or entities they belong to, each with the names of its bodies, in order.
        positions: (k, n, 3) positions of their bases [m].
        orientations: (k, n, 4) quaternions x, y, z, w.
        joints: (k, n, joints) joint positions [rad] or [m].
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
    """A horizontal plane.

    Attributes:
        height: Its height [m].
    """

    height: float


@dataclass(frozen=True, kw_only=True)
class FocusPoint(_Mark):
    """A point that the camera can follow.

    Attributes:
        positions: (k, 3) [m].
        reach: Radius of a ring around it [m]; None for none.
    """

    positions: Array
    reach: float | None = None


@dataclass(frozen=True, kw_only=True)
class Rays(_Mark):
    """The ends of rays from sensors; several sensors may share an instant.

    Attributes:
        times: (k,) not descending [ns].
        names: (k,) name of the sensor.
        colours: (k, 3).
        angles: (k,) angles of the rays, counter-clockwise from the heading of the sensor [rad].
        distances: (k,) lengths of the rays [m]; not finite if a ray hits nothing.
        poses: (k, 4) x, y, z and heading of the sensor [m], [rad].
        size: Size of a point [pixels].
        spatial: Whether the world is spatial.
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
    """Images of a camera.

    Attributes:
        kind: Colour or depth.
        files: (k,) PNG files.
        frame: Name of the frame attached to the camera.
        positions: (k, 3) positions of the camera [m].
        targets: (k, 3) points at the centre of the image [m].
        fields_of_view: (k,) vertical fields of view [rad].
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
        colours: (m, 3); None for default colours.
        width: Width of the lines [pixels].
        keep: The extremes to keep if there are more instants than pixels; a mean would hide short peaks.
        level: Name and height of a reference line; None for none.
        stepwise: Whether a value holds until the next one, as inputs and bounds do, rather than changing gradually.
    """

    values: Array
    names: Sequence[str]
    colours: ArrayLike | None = None
    width: float = 1.5
    level: tuple[str, float] | None = None
    keep: Literal["greatest", "least", "both"] = "both"
    stepwise: bool = False


@dataclass(frozen=True, kw_only=True)
class Numbers(_Mark):
    """A table of numbers over time, for backends in which users choose what to plot.

    Attributes:
        values: (k, n, m).
        names: (n,) names of the rows.
        columns: (m,) name and unit of each column.
        separate: Whether instants are separate entries, so that times may repeat; otherwise values hold until the next.
    """

    values: Array
    names: Sequence[str]
    columns: Sequence[tuple[str, str]]
    separate: bool = False


@dataclass(frozen=True, kw_only=True)
class Journal(_Mark):
    """Lines of a text log.

    Attributes:
        times: (k,) not descending [ns].
        kinds: (k,) names of the events.
        sources: (k,) their origins.
        texts: (k,) descriptions.
        levels: (k,) DEBUG, INFO, WARNING or ERROR.
    """

    kinds: Sequence[str]
    sources: Sequence[str]
    texts: Sequence[str]
    levels: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Modes(_Mark):
    """Discrete modes over time.

    Attributes:
        modes: (k,) names of modes.
        tints: Colours of modes by name; others have default colours.
    """

    modes: Sequence[str]
    tints: Mapping[str, Sequence[int]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Documents(_Mark):
    """A text that changes.

    Attributes:
        texts: (k,) Markdown.
    """

    texts: Sequence[str]


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
    | Documents
)
"""Any mark."""


def mark_fault(mark: object) -> str | None:
    """Return why an object is not a mark, as a predicate; None if it is one, whose arrays are not checked further."""
    if not isinstance(mark, Mark):
        return f"draws a {type(mark).__name__}, which is not a mark"
    if not isinstance(mark.path, str) or not mark.path or mark.path.startswith("/"):
        return f"draws at {mark.path!r}, which is not a path such as `world/mine`"
    times = mark.times
    if not isinstance(times, np.ndarray) or times.dtype != np.int64 or times.ndim != 1 or (np.diff(times) < 0).any():
        return f"draws at `{mark.path}` at times that are not ascending whole numbers of nanoseconds (int64)"
    return None


Joinable = TypeVar("Joinable", Bodies, Solid, Curves, Numbers, Modes)


def joined(parts: Sequence[Joinable]) -> Joinable:
    """Join marks of one path, which follow each other in time, into one mark."""
    names = ["times", *(name for name in ("positions", "orientations", "values") if hasattr(parts[0], name))]
    if isinstance(parts[0], Bodies):
        names.append("colours")
    if getattr(parts[0], "phases", None) is not None:
        names.append("phases")
    whole: Any = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    if isinstance(parts[0], Modes):
        whole["modes"] = [mode for part in parts for mode in getattr(part, "modes")]  # noqa: B009 # of the first's type
    return replace(parts[0], **whole)
