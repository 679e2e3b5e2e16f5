"""Checks whether a linear model can make exactly the transitions of a transition system, each in one step.

The control inputs of the model lie in a box. Its position may be anywhere in its cell, which is a box; the other
elements of its state, such as velocities, may be anywhere within bounds, which they must not leave. If each transition
can be made from every such state (1), each strategy for the system can be followed. If also each move is a transition
(2), the states of the cells and the cells are bisimilar: with the observation map of the system, the system and the
model have the same observations, step by step (Alur, Henzinger, Lafferriere and Pappas, Discrete abstractions of hybrid
systems, Proceedings of the IEEE 88(7), 2000).

The states from which a convex set can be reached in a step are a convex set, so (1) is checked at the corners of cells.
For a single integrator, square cells of side h, and moves of up to m h, m a whole number, the transitions of a
bisimulation are those to all cells at most m columns and m rows away.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Model
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.planning import LinearDynamics

Array = NDArray[np.float64]

_TOLERANCE = 1e-9

#: The least width of the part of a cell that a move leads into, for solvers of linear programs.
_WIDTH = 1e-7


@dataclass(frozen=True)
class Bisimulation:
    """The differences between the moves of a model and the transitions of a system.

    Attributes:
        impossible: Transitions that cannot be made from every state of the cell in one step.
        missing: Moves from one cell into another, in one step, that are no transitions.
    """

    impossible: tuple[tuple[str, str], ...]
    missing: tuple[tuple[str, str], ...]

    @property
    def follows(self) -> bool:
        """Whether each strategy can be followed with one step for each transition."""
        return not self.impossible

    @property
    def holds(self) -> bool:
        """Whether cells are a bisimulation."""
        return not self.impossible and not self.missing


def bisimulation(
    model: KnowledgeModel,
    reach: float | None = None,
    *,
    moves: Model | LinearDynamics | None = None,
    step: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Bisimulation:
    """Compare a knowledge model with a linear model of motion, or with a single integrator.

    Args:
        model: The knowledge model, prepared.
        reach: How far a single integrator moves at most along each axis in a step [m]; instead of `moves`.
        moves: A linear model, or its dynamics over a step, whose first two elements of the state are the position.
        step: The duration of a step of a model [s]; by default that of a model in discrete time.
        bounds: Least and greatest value of each element of a model's state but its position, by name; of dynamics, the
            names are ``x2``, ``x3`` and so on.

    Raises:
        ValueError: The states of the knowledge model have no places; the model of motion is not linear, its control
            inputs are not in a box, or an element of its state has no bounds.
    """
    if not len(model.bounds):
        raise ValueError("the states of the model have no places, so nothing moves between them")
    if (reach is None) == (moves is None):
        raise ValueError("cells are compared with a single integrator (`reach`) or with a model (`moves`)")
    motion = _Motion.of(reach if moves is None else moves, step, dict(bounds or {}))
    low, high = motion.boxes(np.asarray(model.bounds, float))
    allowed = np.zeros((len(low), len(low)), bool)
    for state, after in enumerate(model.system.successors):
        allowed[state, list(after)] = True
    impossible = [
        (one, other) for one, other in np.argwhere(allowed).tolist() if not motion.reaches(low, high, one, other)
    ]
    missing = [(one, other) for one, other in motion.near(low, high, ~allowed) if motion.enters(low, high, one, other)]
    states = model.system.states
    return Bisimulation(
        tuple((states[one], states[other]) for one, other in impossible),
        tuple((states[one], states[other]) for one, other in missing),
    )


class _Motion:
    """A step of a linear model, x+ = A x + B u + c with u in a box; boxes of states are (low, high), each (n, nx)."""

    def __init__(
        self, dynamics: LinearDynamics, place: tuple[int, ...], rest: Mapping[int, tuple[float, float]]
    ) -> None:
        if len(dynamics.normals):
            raise ValueError("the length of its control input is limited, and not each element, as in a box")
        if not (np.isfinite(dynamics.least).all() and np.isfinite(dynamics.greatest).all()):
            raise ValueError("its control inputs are not limited")
        self._A, self._B, self._c = dynamics.A, dynamics.B, dynamics.c
        self._least, self._greatest = dynamics.least, dynamics.greatest
        self._place, self._rest = place, rest
        ends = np.stack([self._B * self._least, self._B * self._greatest])
        #: What control inputs add to the next state; each of shape (nx,).
        self._added = ends.min(axis=0).sum(axis=1), ends.max(axis=0).sum(axis=1)
        #: Whether the elements of the next state depend on control inputs of their own.
        self._is_apart = bool(((self._B != 0.0).sum(axis=0) <= 1).all())
        #: Whether they depend on elements of the state of their own besides.
        self._is_separable = self._is_apart and bool(((self._A != 0.0).sum(axis=0) <= 1).all())

    @classmethod
    def of(
        cls, moves: float | Model | LinearDynamics | None, step: float | None, bounds: dict[str, tuple[float, float]]
    ) -> _Motion:
        """Return the motion of a model, of dynamics, or of a single integrator that moves by up to a distance."""
        if isinstance(moves, LinearDynamics):
            size = len(moves.A)
            return cls(moves, (0, 1), _bounds([f"x{place}" for place in range(size)], (0, 1), bounds))
        if isinstance(moves, Model):
            names = [quantity.name for quantity in moves.state]
            place = (moves.position[0], moves.position[1])
            duration = moves.time_step if step is None else step
            if duration is None:
                raise ValueError("a model in continuous time needs the duration of a `step`")
            return cls(LinearDynamics.of(moves, duration), place, _bounds(names, place, bounds))
        reach = np.full(2, float(moves or 0.0))
        still = LinearDynamics(np.eye(2), np.eye(2), np.zeros(2), -reach, reach, np.zeros((0, 2)), np.zeros(0))
        return cls(still, (0, 1), _bounds(["x0", "x1"], (0, 1), bounds))

    def boxes(self, cells: Array) -> tuple[Array, Array]:
        """Return the states of cells, (n, 2, 2) as [cell, axis, which]."""
        size = len(self._A)
        low, high = np.empty((len(cells), size)), np.empty((len(cells), size))
        for axis, element in enumerate(self._place):
            low[:, element], high[:, element] = cells[:, axis, 0], cells[:, axis, 1]
        for element, (least, greatest) in self._rest.items():
            low[:, element], high[:, element] = least, greatest
        return low, high

    def near(self, low: Array, high: Array, among: NDArray[np.bool_]) -> list[tuple[int, int]]:
        """Return the pairs of boxes among some where each element of the next state may be inside of the second one."""
        ends = np.stack([self._A[None] * low[:, None], self._A[None] * high[:, None]])
        first = ends.min(axis=0).sum(axis=2) + self._c + self._added[0]
        last = ends.max(axis=0).sum(axis=2) + self._c + self._added[1]
        met = among.copy()
        for element in range(low.shape[1]):
            met &= first[:, None, element] < high[None, :, element] - _TOLERANCE
            met &= last[:, None, element] > low[None, :, element] + _TOLERANCE
        return [(one, other) for one, other in np.argwhere(met).tolist()]

    def reaches(self, low: Array, high: Array, one: int, other: int) -> bool:
        """Whether a control input leads from every state of one box into another."""
        used = [(a, b) if a != b else (a,) for a, b in zip(low[one].tolist(), high[one].tolist(), strict=True)]
        for corner in product(*used):
            free = self._A @ np.array(corner) + self._c
            if (free + self._added[0] > high[other] + _TOLERANCE).any():
                return False
            if (free + self._added[1] < low[other] - _TOLERANCE).any():
                return False
            if not self._is_apart and not _feasible(
                self._B, low[other] - free - _TOLERANCE, high[other] - free + _TOLERANCE, self._least, self._greatest
            ):
                return False
        return True

    def enters(self, low: Array, high: Array, one: int, other: int) -> bool:
        """Whether a control input leads from a state of one box into the inside of another, which is `near`."""
        if self._is_separable:
            return True
        width = np.minimum(_WIDTH, 0.25 * (high[other] - low[other]))
        return _feasible(
            np.concatenate([self._A, self._B], axis=1),
            low[other] - self._c + width,
            high[other] - self._c - width,
            np.concatenate([low[one], self._least]),
            np.concatenate([high[one], self._greatest]),
        )


def _bounds(
    names: list[str], place: tuple[int, ...], bounds: dict[str, tuple[float, float]]
) -> dict[int, tuple[float, float]]:
    for name in bounds:
        if name not in names or names.index(name) in place:
            others = ", ".join(each for number, each in enumerate(names) if number not in place)
            said = f"`bounds` names `{name}`; the elements of the state besides the position: {others or 'none'}"
            raise ValueError(said)
    found = {}
    for number, name in enumerate(names):
        if number not in place:
            if name not in bounds:
                raise ValueError(f"`bounds` has to say between which values `{name}` stays")
            found[number] = bounds[name]
    return found


def _feasible(rows: Array, lower: Array, upper: Array, least: Array, greatest: Array) -> bool:
    """Whether lower <= rows @ x <= upper for an x in a box."""
    from scipy.optimize import linprog

    found = linprog(
        np.zeros(rows.shape[1]),
        np.concatenate([rows, -rows]),
        np.concatenate([upper, -lower]),
        bounds=list(zip(least.tolist(), greatest.tolist(), strict=True)),
    )
    return int(found.status) == 0
