"""Signals: what a component hands out beside awareness, declared once as data and recorded on a channel of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np

from symaware_cli.awareness.column import Column, SeriesColumn
from symaware_cli.awareness.table_column import TableColumn
from symaware_cli.world.model import Quantity

Kind = Literal["vector", "series", "table"]
Drawn = Literal["curve", "path", "ellipse", "bars", "points"]
SignalColumn: TypeAlias = "Column | SeriesColumn | TableColumn"

MEASUREMENT = "measurement"
"""The signal that is known by the name of its component alone, as that of a sensor that measures a few numbers."""

#: What says where points are: in the world, or seen from the body.
_PLACES = (("x", "y"), ("distance", "bearing"))

#: How each kind can be drawn.
_DRAWN: dict[str, tuple[str | None, ...]] = {
    "vector": ("curve", "bars", "points", None),
    "series": ("curve", "path", "ellipse", "bars", None),
    "table": ("curve", "points", None),
}


@dataclass(frozen=True, slots=True)
class Signal:
    """What a component says of each agent in its turns; whatever records, shows or exports goes through those declared.

    Attributes:
        name: A Python identifier; the topic ``/agents/<group>/<name>/<component>`` has it.
        kind: ``vector``, a row of numbers for each agent, NaN until something is written; ``series``, a `TimeSeries`
            for each agent; or ``table``, any number of rows of numbers for each agent.
        columns: Name and unit of each number; None for a series of which nobody says it.
        drawn: How it is drawn, which the log says too: as a ``curve`` for each number; as a ``path`` through the
            positions of a series; as the ``ellipse`` of the covariance of the position in one; as ``bars`` for numbers
            that share a whole, such as probabilities; or as ``points``, which takes columns ``x`` and ``y`` (and ``z``)
            in the world, or ``distance`` and ``bearing`` (and ``elevation``) from the body, counter-clockwise from its
            heading. None for not at all.
        description: What it says, in a few words.
    """

    what: ClassVar = "signal"

    name: str
    kind: Kind = "vector"
    columns: Sequence[Quantity] | None = None
    drawn: Drawn | None = "curve"
    description: str = ""

    def __post_init__(self) -> None:
        what = f"the {self.what} `{self.name}`"
        if not self.name.isidentifier() or self.name != self.name.lower():
            raise ValueError(f"the name of a {self.what} is an identifier in lower case, not {self.name!r}")
        for key, given, known in (
            ("kind", self.kind, get_args(Kind)),
            ("drawn", self.drawn, (*get_args(Drawn), None)),
        ):
            if given not in known:
                listed = ", ".join(str(each) for each in known)
                raise ValueError(f"`{key}` of {what} is one of {listed}, not {given!r}")
        if self.drawn not in _DRAWN[self.kind]:
            kinds = " or a ".join(kind for kind, known in _DRAWN.items() if self.drawn in known)
            drawn = {"ellipse": "an ellipse", "bars": "bars", "points": "points"}.get(
                self.drawn or "", f"a {self.drawn}"
            )
            raise ValueError(f"{what} is a {self.kind}, and only a {kinds} is drawn as {drawn}")
        if self.columns is None:
            return
        columns = tuple(self.columns)
        if not columns or not all(isinstance(column, Quantity) for column in columns):
            raise ValueError(f"the columns of {what} are a `Quantity` each, and at least one")
        if len({column.name for column in columns}) < len(columns):
            raise ValueError(f"two columns of {what} have the same name")
        object.__setattr__(self, "columns", columns)
        if self.drawn == "points" and not any({*pair} <= {*self.column_names} for pair in _PLACES):
            pairs = ", or ".join(f"`{one}` and `{other}`" for one, other in _PLACES)
            raise ValueError(f"{what} is drawn as points, which takes columns {pairs}")

    @property
    def column_names(self) -> tuple[str, ...]:
        """The names of the columns; empty where they are not known."""
        return tuple(column.name for column in self.columns or ())

    def field(self, component: str) -> str:
        """What it is called where a component of that name hands it out, such as ``radar.returns``."""
        return component if self.name == MEASUREMENT else f"{component}.{self.name}"

    def column(self, count: int) -> SignalColumn:
        """Make the column of a group, in which nothing is said yet.

        Args:
            count: How many agents there are.

        Raises:
            ValueError: It is no series, and nobody says how many numbers it has.
        """
        if self.kind == "series":
            return SeriesColumn(count)
        if self.columns is None:
            raise ValueError(f"the {self.what} `{self.name}` is a {self.kind} without columns")
        if self.kind == "table":
            return TableColumn(count, len(self.columns))
        column = Column(np.full((count, len(self.columns)), np.nan))
        column.take_changes()  # what nobody wrote is not worth a record
        return column

    def of(self, columns: Sequence[Quantity]) -> Self:
        """The same with columns that are known now; None where there are none."""
        return replace(self, columns=tuple(columns) or None)
