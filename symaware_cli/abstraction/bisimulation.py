"""Whether a single integrator can do in a step of a strategy what a transition system says, and nothing else.

The integrator moves by at most a given distance along each axis in a step, from anywhere in its cell. If each
transition can be made from every point (1), each strategy for the system can be followed. If besides each move leads
along a transition (2), cells are a bisimulation: the system and the integrator have the same observations, step by step
(Alur, Henzinger, Lafferriere and Pappas, Discrete abstractions of hybrid systems, Proceedings of the IEEE 88(7), 2000).
For square cells of side h and moves of up to m h, m a whole number, the transitions of such a bisimulation are those to
all cells at most m columns and m rows away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symaware_cli.abstraction.knowledge_model import KnowledgeModel

_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Bisimulation:
    """How moves of an integrator and transitions differ.

    Attributes:
        impossible: Transitions that cannot be made from every point of the cell in one step.
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


def bisimulation(model: KnowledgeModel, reach: float) -> Bisimulation:
    """Compare a knowledge model with a single integrator.

    Args:
        model: The model, prepared.
        reach: How far the integrator moves at most along each axis in a step [m].

    Raises:
        ValueError: The states of the model have no places.
    """
    if not len(model.bounds):
        raise ValueError("the states of the model have no places, so no integrator moves between them")
    low, high = model.bounds[:, :, 0], model.bounds[:, :, 1]
    forward, backward = low[None] - low[:, None], high[:, None] - high[None]
    farthest = np.maximum(forward, backward).max(axis=2)  # from the worst point of a cell, along the worse axis
    gap = np.maximum(low[None] - high[:, None], low[:, None] - high[None]).max(axis=2)
    allowed = np.zeros(gap.shape, bool)
    for state, after in enumerate(model.system.successors):
        allowed[state, list(after)] = True
    return Bisimulation(
        _named(model, allowed & (farthest > reach + _TOLERANCE)),
        _named(model, ~allowed & (gap < reach - _TOLERANCE)),
    )


def _named(model: KnowledgeModel, pairs: np.ndarray) -> tuple[tuple[str, str], ...]:
    states = model.system.states
    return tuple((states[one], states[other]) for one, other in np.argwhere(pairs).tolist())
