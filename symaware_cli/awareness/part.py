"""Parts of awareness: what an agent is aware of, of itself and of others, declared once as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from symaware_cli.awareness.column import Column, SeriesColumn
from symaware_cli.world.model import Quantity

Kind = Literal["vector", "series"]
Merge = Literal["latest", "seen-first"]
Drawn = Literal["curve", "path", "ellipse", "bars"]
PartColumn: TypeAlias = "Column | SeriesColumn"


@dataclass(frozen=True, slots=True)
class Part:
    """A part of awareness; what records, sends, shows or exports awareness goes through the parts that are declared.

    Attributes:
        name: A Python identifier; the topic ``/agents/<group>/<name>`` has it, and expressions know it by that.
        kind: ``vector``, a row of numbers for each agent, NaN until something is written; or ``series``, a `TimeSeries`
            for each agent.
        columns: Name and unit of each number; None for a series of which the components say it
            (`BaseComponent.series_quantities`), or nobody does.
        merge: Which of two sources counts of another agent's part: the ``latest``, or with ``seen-first`` what an
            agent's own components wrote, and only where they wrote nothing what it was told.
        drawn: How it is drawn, which the log says too: as a ``curve`` for each number; as a ``path`` through the
            positions of a series; as the ``ellipse`` of the covariance of the position in one; as ``bars`` for numbers
            that share a whole, such as probabilities. None for not at all.
        description: What it says, in a few words.
    """

    name: str
    kind: Kind = "vector"
    columns: Sequence[Quantity] | None = None
    merge: Merge = "seen-first"
    drawn: Drawn | None = "curve"
    description: str = ""

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.name != self.name.lower():
            raise ValueError(f"the name of a part is an identifier in lower case, not {self.name!r}")
        for what, given, known in (
            ("kind", self.kind, get_args(Kind)),
            ("merge", self.merge, get_args(Merge)),
            ("drawn", self.drawn, (*get_args(Drawn), None)),
        ):
            if given not in known:
                listed = ", ".join(str(each) for each in known)
                raise ValueError(f"`{what}` of the part `{self.name}` is one of {listed}, not {given!r}")
        if self.kind == "vector" and self.drawn in ("path", "ellipse"):
            raise ValueError(f"the part `{self.name}` is a vector, and only a series is drawn as a {self.drawn}")
        if self.columns is None:
            return
        columns = tuple(self.columns)
        if not columns or not all(isinstance(column, Quantity) for column in columns):
            raise ValueError(f"the columns of the part `{self.name}` are a `Quantity` each, and at least one")
        if len({column.name for column in columns}) < len(columns):
            raise ValueError(f"two columns of the part `{self.name}` have the same name")
        object.__setattr__(self, "columns", columns)

    @property
    def column_names(self) -> tuple[str, ...]:
        """The names of the columns; empty where they are not known."""
        return tuple(column.name for column in self.columns or ())

    def column(self, count: int) -> PartColumn:
        """Make the column of a group, in which nothing is said yet.

        Args:
            count: How many agents there are.

        Raises:
            ValueError: It is a vector of which nobody says how long it is.
        """
        if self.kind == "series":
            return SeriesColumn(count)
        if self.columns is None:
            raise ValueError(f"the part `{self.name}` is a vector without columns")
        column = Column(np.full((count, len(self.columns)), np.nan))
        column.take_changes()  # what nobody wrote is not worth a record
        return column

    def of(self, columns: Sequence[Quantity]) -> Part:
        """The same part with columns that are known now; None where there are none."""
        return replace(self, columns=tuple(columns) or None)


STATE = Part("state", "vector", merge="latest", description="as believed")
INTENT = Part("intent", "series", drawn="path", description="what the agent means to do at that time")
UNCERTAINTY = Part(
    "uncertainty", "series", merge="latest", drawn="ellipse", description="what the agent is not sure of at that time"
)
RISK = Part("risk", "series", description="how much at risk the agent deems itself at that time")

#: The parts that every group has.
PARTS = (STATE, INTENT, UNCERTAINTY, RISK)
