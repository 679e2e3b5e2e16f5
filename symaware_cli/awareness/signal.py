"""Signals: quantities that components publish besides awareness, declared as data; parts of awareness are in `part`.

Reasons: docs/decisions/0028-signals.md
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np

from symaware_cli.awareness.column import Column, TableColumn
from symaware_cli.awareness.series_column import SeriesColumn
from symaware_cli.awareness.value_range import ValueRange
from symaware_cli.world import Quantity, record

Kind = Literal["vector", "series", "table"]
Drawn = Literal["curve", "path", "ellipse", "bars", "points", "links", "boxes", "areas"]
SignalColumn: TypeAlias = "Column | SeriesColumn | TableColumn"

MEASUREMENT = "measurement"
"""The name of a signal that is referred to by the name of its component alone, such as the measurement of a sensor."""

#: The columns that define the positions of points: in the world, or relative to the body.
_PLACES = (("x", "y"), ("distance", "bearing"))
#: The columns that define boxes.
BOX_COLUMNS = ("x_low", "x_high", "y_low", "y_high")

#: How each kind can be drawn.
_DRAWN: dict[str, tuple[str | None, ...]] = {
    "vector": ("curve", "bars", "points", None),
    "series": ("curve", "path", "ellipse", "bars", None),
    "table": ("curve", "points", "links", "boxes", "areas", None),
}


@record
class Signal:
    """A quantity that a component records for each agent. Recording, replay and export use its declaration.

    Attributes:
        name: A Python identifier, which is used in the topic ``/agents/<group>/<name>/<component>``.
        kind: ``vector``, a row of numbers for each agent, NaN until something is written; ``series``, a `TimeSeries`
            for each agent; or ``table``, any number of rows of numbers for each agent.
        columns: Name and unit of each number; None for a series whose columns are not defined.
        drawn: How it is drawn, which is stored in the log: as a ``curve`` for each number; as a ``path`` through the
            positions of a series; as the ``ellipse`` of the covariance of a position; as ``bars`` for shares of a
            whole, such as probabilities; or as ``points``, which requires the columns ``x`` and ``y`` (and ``z``) in
            the world, or ``distance`` and ``bearing`` (and ``elevation``) relative to the body, counter-clockwise from
            its heading; or as ``links``, arrows to the agents or entities whose indices in the roster the column
            ``agent`` has; or as ``boxes`` in the plane, which require the columns ``x_low``, ``x_high``, ``y_low`` and
            ``y_high``, with a cross where the column ``crossed`` is not 0; or as ``areas`` with the same columns, light
            where the column ``occupied`` is 0 and dark where it is 1, or the darker the greater a probability in the
            column ``level`` is. None if it is not drawn.
        description: Its meaning, in a few words.
        nan: The meaning of NaN in it; None if a component that writes NaN fails.
        infinity: The meaning of infinity in it; None if a component that writes infinity fails.
    """

    what: ClassVar = "signal"

    name: str
    kind: Kind = "vector"
    columns: Sequence[Quantity] | None = None
    drawn: Drawn | None = "curve"
    description: str = ""
    nan: str | None = None
    infinity: str | None = None

    def __post_init__(self) -> None:
        what = f"the {self.what} `{self.name}`"
        if not self.name.isidentifier() or self.name != self.name.lower():
            raise ValueError(f"the name of a {self.what} is an identifier in lower case, not {self.name!r}")
        for key, given, known in (("kind", self.kind, get_args(Kind)), ("drawn", self.drawn, (*get_args(Drawn), None))):
            if given not in known:
                listed = ", ".join(str(each) for each in known)
                raise ValueError(f"`{key}` of {what} is one of {listed}, not {given!r}")
        if self.drawn not in _DRAWN[self.kind]:
            kinds = " or a ".join(kind for kind, known in _DRAWN.items() if self.drawn in known)
            plural = {each: each for each in ("bars", "points", "links", "boxes", "areas")}
            drawn = {"ellipse": "an ellipse", **plural}.get(self.drawn or "", f"a {self.drawn}")
            raise ValueError(f"{what} is a {self.kind}, and only a {kinds} is drawn as {drawn}")
        if self.columns is None:
            return
        columns = tuple(self.columns)
        if not columns or not all(isinstance(column, Quantity) for column in columns):
            raise ValueError(f"the columns of {what} are a `Quantity` each, and at least one")
        if len({column.name for column in columns}) < len(columns):
            raise ValueError(f"two columns of {what} have the same name")
        object.__setattr__(self, "columns", columns)
        self._require_drawable(what)

    def _require_drawable(self, what: str) -> None:
        """Raise an error if the columns are not those that are drawn in this way."""
        if self.drawn == "points" and not any({*pair} <= {*self.column_names} for pair in _PLACES):
            pairs = ", or ".join(f"`{one}` and `{other}`" for one, other in _PLACES)
            raise ValueError(f"{what} is drawn as points, which takes columns {pairs}")
        if self.drawn == "links" and "agent" not in self.column_names:
            raise ValueError(f"{what} is drawn as links, which takes a column `agent`")
        shade = "level" if "level" in self.column_names else "occupied"
        needed = (*BOX_COLUMNS, shade) if self.drawn == "areas" else BOX_COLUMNS
        if self.drawn in ("boxes", "areas") and not {*needed} <= {*self.column_names}:
            listed = ", ".join(f"`{each}`" for each in needed)
            raise ValueError(f"{what} is drawn as {self.drawn}, which takes columns {listed}")

    @property
    def column_names(self) -> tuple[str, ...]:
        """The names of the columns; empty if they are not known."""
        return tuple(column.name for column in self.columns or ())

    @property
    def bounds(self) -> ValueRange:
        """The numbers that may be written."""
        return ValueRange(nan=self.nan is not None, infinity=self.infinity is not None)

    def field(self, component: str) -> str:
        """Return its full name for a component of a name, such as ``radar.returns``."""
        return component if self.name == MEASUREMENT else f"{component}.{self.name}"

    def column(self, count: int) -> SignalColumn:
        """Create the empty column of a group.

        Args:
            count: The number of agents.

        Raises:
            ValueError: It is not a series, and its columns are not defined.
        """
        if self.kind == "series":
            return SeriesColumn(count, self.bounds)
        if self.columns is None:
            raise ValueError(f"the {self.what} `{self.name}` is a {self.kind} without columns")
        if self.kind == "table":
            return TableColumn(count, len(self.columns), self.bounds)
        # An empty column is not recorded.
        return Column(np.full((count, len(self.columns)), np.nan), self.bounds, fresh=False)

    def of(self, columns: Sequence[Quantity]) -> Self:
        """Return a copy with these columns; None for undefined columns."""
        return replace(self, columns=tuple(columns) or None)
