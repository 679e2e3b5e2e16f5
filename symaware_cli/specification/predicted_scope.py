"""Scopes of predictions: the names of specifications, with values from predicted motions."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Region
from symaware_cli.specification.formula import Array
from symaware_cli.specification.scope import LINK, AgentScope, KnownValues, PairScope, World


class PredictedMotion(Protocol):
    """Predicted states of some agents and of others at one instant: R rows, several for each agent.

    Attributes:
        time: The instant [s].
        states: The predicted states; shape (R, nx).
        inputs: The control inputs; shape (R, nu).
    """

    time: float
    states: Array
    inputs: Array

    def nearest(self) -> Array:
        """Return the distance to the nearest other [m], infinite if there is none; shape (R,)."""

    def pose(self, id: str) -> tuple[Array, Array | None]:
        """Return the position of an agent, shape (R, d) [m], NaN if unknown, and its heading [rad], if it has one."""

    def repeated(self, values: Array) -> Array:
        """Repeat values of the agents of the group, shape (n, ...), for each of their rows; shape (R, ...)."""

    def pairs(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return the positions [m] and the velocities [m/s] of agents and others; each of shape (m, samples, d)."""


class PredictedAgentScope(AgentScope):
    """Predicted states of the agents of a group.

    Attributes:
        motion: The predicted motion; see `of`.
    """

    motion: PredictedMotion

    def of(self, motion: PredictedMotion) -> PredictedAgentScope:
        """Return a scope for a motion."""
        other = copy.copy(self)
        other.motion = motion
        other.regions = {name: each.at(other.anchor) for name, each in self.regions.items()}
        return other

    @property
    def states(self) -> Array:
        """The predicted states."""
        return self.motion.states

    @property
    def inputs(self) -> Array:
        """The control inputs."""
        return self.motion.inputs

    def look_up(self, name: str) -> Any:
        """See the base class."""
        return self.motion.time if name == "time" else super().look_up(name)

    def anchor(self, id: str) -> tuple[Array, Any]:
        """Return the predicted pose of an agent, for each row."""
        return self.motion.pose(id)

    def _look_up(self, name: str) -> Any:
        known = _Repeated(KnownValues(self.group), self.motion)
        return known if name == "knowledge" else known[name] if name in self._known else super()._look_up(name)

    def _nearest(self) -> Array:
        return self.motion.nearest()


class PredictedPairScope(PairScope):
    """Predicted relations between agents and others that they are aware of."""

    def __init__(
        self,
        world: World,
        regions: Mapping[str, Region],
        motion: PredictedMotion,
        chosen: NDArray[np.intp],
        swapped: NDArray[np.bool_],
    ) -> None:
        """Create the scope.

        Args:
            world: The world.
            regions: The regions by name.
            motion: The predicted motion.
            chosen: Which pairs of the motion are meant; shape (m,).
            swapped: Whether the other is the first agent of each; shape (m,).
        """
        super().__init__((), world, list(world.groups), regions)
        self._motion = motion
        self._chosen = chosen
        self._swapped = swapped

    def look_up(self, name: str) -> Any:
        """See the base class."""
        return self._motion.time if name == "time" else super().look_up(name)

    def anchor(self, id: str) -> tuple[Array, Any]:
        """Raise an error: it is not known which of several samples of the pose belongs to a pair."""
        raise ValueError(f"a region around `{id}` is not predicted for pairs")

    def _look_up(self, name: str) -> Any:
        if name == LINK:
            raise ValueError("positions of links are not predicted for pairs")
        self.rows = len(self._positions()[0])
        return super()._look_up(name)

    def _positions(self) -> tuple[Array, Array]:
        return self._of_chosen(*self._motion.pairs()[0])

    def _velocities(self) -> tuple[Array, Array]:
        return self._of_chosen(*self._motion.pairs()[1])

    def _of_chosen(self, own: Array, other: Array) -> tuple[Array, Array]:
        """Return the values of the first and of the second agents; each of shape (m, samples, d)."""
        swapped = self._swapped[:, None, None]
        own, other = own[self._chosen], other[self._chosen]
        ordered = np.where(swapped, other, own), np.where(swapped, own, other)
        size = own.shape[2]
        return ordered[0].reshape(-1, size), ordered[1].reshape(-1, size)


class _Repeated(Mapping[str, Any]):
    """Knowledge, repeated for each row of a prediction."""

    def __init__(self, known: Mapping[str, Any], motion: PredictedMotion) -> None:
        self._known = known
        self._motion = motion

    def __getitem__(self, name: str) -> Any:
        return self._motion.repeated(np.asarray(self._known[name]))

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)
