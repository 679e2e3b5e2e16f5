"""Line styles of the agents in a plot, and the choice of agents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from symaware_cli.views.palette import DISTINCT


@dataclass(frozen=True)
class LineStyle:
    """The style of the lines of an agent.

    Attributes:
        name: The agent, or the name of another curve.
        colour: As ``#rrggbb``.
        dashed: Whether lines are dashed, because another name has the same colour.
    """

    name: str
    colour: str
    dashed: bool = False


@dataclass(frozen=True)
class Chosen:
    """The agents chosen for a plot.

    Attributes:
        members: The style of each chosen agent, by group; groups without one are omitted.
    """

    members: Mapping[str, tuple[LineStyle, ...]]

    @cached_property
    def lines(self) -> tuple[LineStyle, ...]:
        """The style of each agent, group by group."""
        return tuple(line for lines in self.members.values() for line in lines)

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """The ids of the chosen agents, in the order of `lines`."""
        return tuple(line.name for line in self.lines)

    @property
    def many(self) -> bool:
        """Whether there are too many agents to tell them apart."""
        return len(self.lines) > DISTINCT

    @property
    def groups(self) -> tuple[LineStyle, ...]:
        """The style of each group, for plots of many agents."""
        return tuple(LineStyle(name, lines[0].colour) for name, lines in self.members.items())
