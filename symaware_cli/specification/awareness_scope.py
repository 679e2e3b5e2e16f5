"""The scope of awareness contracts: the beliefs of an agent about another, beside the truth.

Reasons: docs/decisions/0091-awareness-contracts.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Region
from symaware_cli.specification.formula import Array
from symaware_cli.specification.parser import Keys, Names
from symaware_cli.specification.scope import PairScope, World

#: The unit of each name of `AwarenessScope`. Positions are those in the world, so that states of any models compare.
AWARENESS_UNITS: Mapping[str, str] = {
    "belief": "m",
    "believed_velocity": "m/s",
    "closing_speed": "m/s",
    "distance": "m",
    "known": "",
    "time": "s",
    "true_velocity": "m/s",
    "truth": "m",
}
#: The names of the two agents of a row in formulas: the one whose awareness it is, and the one that it is about.
SELF, OTHER = "self", "other"


class AwarenessScope(PairScope):
    """The beliefs of an agent, `self`, about another agent, `other`, and about itself, beside the truth.

    A row without a belief about the other has no value where a formula refers to that belief; see `lacking`.
    """

    units = AWARENESS_UNITS

    def __init__(
        self,
        pairs: Sequence[tuple[str, str]],
        world: World,
        groups: Sequence[AgentGroup],
        regions: Mapping[str, Region],
    ) -> None:
        super().__init__(pairs, world, groups, regions)
        self._places = {id: (group, row) for group in groups for row, id in enumerate(group.ids)}
        self._known: NDArray[np.bool_] = np.ones(self.rows, bool)
        self._lacking = ~self._known

    @property
    def names(self) -> Names:
        """See the base class."""
        both, other = Keys("agent of a contract", (SELF, OTHER)), Keys("agent of a contract", (OTHER,))
        keyed = {"belief": both, "truth": both, "believed_velocity": both, "true_velocity": both, "known": other}
        return {**self._region_names, **dict.fromkeys(self.units), **keyed}

    @property
    def lacking(self) -> NDArray[np.bool_] | None:
        """See the base class: the rows whose agent does not know where the other is, or how fast."""
        return self._lacking

    def subjects(self, row: int) -> tuple[str, ...]:
        """Return the agent whose awareness a row is about."""
        return self._pairs[row][:1]

    def _look_up(self, name: str) -> Any:
        match name:
            case "truth":
                return self._keyed(self._positions())
            case "true_velocity":
                return self._keyed(self._velocities())
            case "belief":
                return self._keyed((self._own(name), self._of_others()[0]))
            case "believed_velocity":
                return self._keyed((self._own(name), self._of_others()[1]))
            case "known":
                self._of_others()
                return {OTHER: self._known.copy()}
        return super()._look_up(name)

    @staticmethod
    def _keyed(values: tuple[Array, Array]) -> Mapping[str, Array]:
        return dict(zip((SELF, OTHER), values, strict=True))

    def _own(self, name: str) -> Array:
        """Return the believed position [m] or velocity [m/s] of each agent itself; shape (n, d)."""
        found = np.zeros((self.rows, self._world.snapshot().positions.shape[1]))
        values: dict[str, Array] = {}
        for row, (id, _) in enumerate(self._pairs):
            group, place = self._places[id]
            if group.name not in values:
                state, model = group.awareness.state, group.model
                is_position = name == "belief"
                values[group.name] = (
                    model.positions(state) if is_position else model.velocity(state, group.control_input)
                )
            of_group = values[group.name]
            found[row, : of_group.shape[1]] = of_group[place]
        return found

    def _of_others(self) -> tuple[Array, Array]:
        """Return the believed positions [m] and velocities [m/s] of the others, NaN if unknown; each of shape (n, d).

        A loop over agents, because the sources of beliefs take precedence for each agent separately.
        """
        snapshot = self._world.snapshot()
        positions = np.full((self.rows, snapshot.positions.shape[1]), np.nan)
        velocities = positions.copy()
        databases: dict[str, Any] = {}
        width = positions.shape[1]
        for row, (id, other) in enumerate(self._pairs):
            if id not in databases:
                group, place = self._places[id]
                databases[id] = group.agents[place].awareness_database
            if other in databases[id]:
                motion = databases[id][other].state
                positions[row], velocities[row] = motion[:width], motion[width : 2 * width]
        self._known = ~np.isnan(positions).any(axis=1)
        self._lacking = ~self._known | np.isnan(velocities).any(axis=1)
        return positions, velocities
