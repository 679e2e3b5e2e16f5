"""Conditions on the distance of an agent from another one, and where the other is expected to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from symaware_cli.core import AgentGroup, EntityGroup
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.planning.risk.predicate_bounds import NotLinearError
from symaware_cli.planning.risk.state_conditions import Conjunction, InsideDisc, Moments, Negation, StateCondition
from symaware_cli.specification.columns import Lookup, values
from symaware_cli.specification.node import Comparison, Name, Node, walk
from symaware_cli.world import SECOND


def pair_bound(node: Node, dimensions: int) -> StateCondition:
    """Compile a predicate of pairs into a condition on the position of the other agent relative to the own one.

    Args:
        node: A comparison of the distance with numbers, such as ``distance > 1``.
        dimensions: The number of dimensions in which the agents move.

    Raises:
        NotLinearError: It is anything else.
    """
    if not isinstance(node, Comparison) or any(each not in _REVERSED for each in node.operators):
        raise NotLinearError("of pairs, only comparisons of `distance` with numbers have a bound")
    parts = [
        _compared(operator, left, right, dimensions)
        for operator, left, right in zip(node.operators, node.operands, node.operands[1:], strict=False)
    ]
    return parts[0] if len(parts) == 1 else Conjunction(parts)


#: Each comparison, with its sides exchanged.
_REVERSED = {">": "<", ">=": "<=", "<": ">", "<=": ">="}


def _compared(operator: str, left: Node, right: Node, dimensions: int) -> StateCondition:
    if not _is_distance(left):
        operator, left, right = _REVERSED[operator], right, left
    if not _is_distance(left) or any(isinstance(each, Name) for each in walk(right)):
        raise NotLinearError("of pairs, only comparisons of `distance` with numbers have a bound")
    bound = float(values(right)(lambda name: None))
    if bound < 0.0:
        raise NotLinearError(f"a distance is never less than {bound:g}")
    within = InsideDisc(lambda look_up: look_up("apart"), np.zeros(dimensions), bound)
    return Negation(within) if operator in (">", ">=") else within


def _is_distance(node: Node) -> bool:
    return isinstance(node, Name) and node.name == "distance"


def check_apart(condition: StateCondition, holds: bool = True) -> None:
    """Check that a condition demands of pairs only that they keep apart.

    Args:
        condition: The condition.
        holds: Whether it shall hold, or its negation.

    Raises:
        NotLinearError: It demands that they come or stay near each other. That depends on the other agent, even if this
            one stands still.
    """
    match condition:
        case Negation(part=part):
            check_apart(part, not holds)
        case Conjunction(parts=parts):
            for each in parts:
                check_apart(each, holds)
        case _ if holds:
            raise NotLinearError("of pairs, only lower bounds of `distance` can be kept")


class OtherPositions(NamedTuple):
    """The expected positions of other agents.

    Attributes:
        mean: Their positions [m]; shape (R, d).
        covariance: Shape (R, d, d).
        is_drifting: Whether deviations grow with an unknown velocity, and not by noise alone; shape (R,).
        known: Which of them are known; shape (R,).
    """

    mean: Array
    covariance: Array
    is_drifting: Mask
    known: Mask

    def take(self, rows: Indices) -> OtherPositions:
        """Return some rows."""
        return OtherPositions(self.mean[rows], self.covariance[rows], self.is_drifting[rows], self.known[rows])

    def where(self, chosen: Mask, otherwise: OtherPositions) -> OtherPositions:
        """Return the chosen rows of these, and the rest of others."""
        return OtherPositions(
            np.where(chosen[:, None], self.mean, otherwise.mean),
            np.where(chosen[:, None, None], self.covariance, otherwise.covariance),
            np.where(chosen, self.is_drifting, otherwise.is_drifting),
            np.where(chosen, self.known, otherwise.known),
        )

    def moments(self, mean: Array, covariance: Array, position: tuple[int, ...]) -> Moments:
        """Return the moments of own states together with the positions of the others; errors are independent.

        Args:
            mean: Of the own states; shape (R, nx).
            covariance: Shape (R, nx, nx).
            position: Which elements of the own state are the position.
        """
        size, places = mean.shape[1], list(position)
        total = size + len(places)
        joint = np.zeros((len(mean), total, total))
        joint[:, :size, :size] = covariance
        joint[:, size:, size:] = self.covariance

        def look_up(states: Array) -> Lookup:
            def of(name: str) -> Any:
                return states[:, size:] - states[:, places]

            return of

        return Moments(np.concatenate([mean, self.mean], axis=1), joint, look_up)


class OthersAhead:
    """Predicts the positions of others: they keep their believed velocity for a while, and then stop.

    The part of a velocity that leads away does not count: they may stop at once, too. All the while they are subject to
    the process noise of their model, along their position and velocity.
    """

    def __init__(self, group: AgentGroup) -> None:
        """Prepare.

        Args:
            group: The agents that predict others.
        """
        environment = group.surroundings.environment
        self._group = group
        self._count = len(environment.roster)
        self._step = environment.time_step
        self._dimensions = len(group.model.position)
        #: Growth of the covariance of position and velocity by each step, for each agent of the roster.
        self._noise = np.concatenate([_noise(each, self._dimensions, self._step) for each in environment.groups])

    def now(self, others: Indices) -> Callable[[Array, int], OtherPositions]:
        """Return a function of instants [ns], shape (n,), and of how long others keep their velocities [ns].

        Args:
            others: The other of each agent of the group, as an index in the roster; -1 for none. Shape (n,).
        """
        group, size = self._group, self._dimensions
        tracks = group.others(np.inf)
        keys = tracks.observers * self._count + tracks.others
        sought = np.arange(len(group)) * self._count + np.maximum(others, 0)
        rows = np.minimum(np.searchsorted(keys, sought), max(len(keys) - 1, 0))
        known = (others >= 0) & (keys[rows] == sought if len(keys) else np.zeros(len(group), bool))
        noise = np.where(known[:, None, None], self._noise[np.maximum(others, 0)], 0.0)
        position, velocity = np.zeros((2, len(group), size))
        believed = np.zeros((len(group), 2 * size, 2 * size))
        if len(keys):
            position = np.where(known[:, None], tracks.positions[rows, :size], 0.0)
            velocity = np.where(known[:, None], tracks.velocities[rows, :size], 0.0)
            if tracks.covariances is not None:
                depth = tracks.positions.shape[1]
                picks = [*range(size), *range(depth, depth + size)]
                believed = np.where(known[:, None, None], tracks.covariances[rows][:, picks][:, :, picks], 0.0)
        apart = position - group.model.positions(group.awareness.state)
        away = (velocity * apart).sum(axis=1) / np.maximum((apart * apart).sum(axis=1), 1e-12)
        velocity = velocity - np.maximum(away, 0.0)[:, None] * apart
        of_position, of_velocity = believed[:, :size, :size], believed[:, size:, size:]
        between = believed[:, :size, size:] + believed[:, size:, :size]
        uncertain = of_velocity.any(axis=(1, 2)) | noise[:, size:].any(axis=(1, 2))
        since, now = tracks.time, group.surroundings.clock.now

        def at(instants: Array, moving: int) -> OtherPositions:
            elapsed = (instants - since)[:, None, None] / SECOND
            moved = np.minimum(elapsed, (now - since + moving) / SECOND)
            grown = noise[:, :size, :size] * elapsed + noise[:, size:, size:] * (moved * moved * moved / 3.0)
            covariance = of_position + between * moved + of_velocity * (moved * moved) + grown
            drifting = uncertain & (instants <= now + moving)
            return OtherPositions(position + velocity * moved[:, :, 0], covariance, drifting, known)

        return at


def _noise(group: EntityGroup, dimensions: int, step: int) -> Array:
    """Return the growth rate of the covariance of agents' positions and velocities by noise; shape (n, 2d, 2d) [1/s].

    Of the model's noise, only that along the first d axes counts. The part of velocities is 0 if the state of the model
    has no velocities.
    """
    model, found = group.model, np.zeros((2 * dimensions, 2 * dimensions))
    covariance = model.noise_covariance(step / SECOND)
    if covariance is not None:
        for first, elements in ((0, model.position), (dimensions, model.velocities)):
            axes = list(elements)[:dimensions]
            places = range(first, first + len(axes))
            found[np.ix_(places, places)] = covariance[np.ix_(axes, axes)] / (step / SECOND)
    return np.broadcast_to(found, (len(group), *found.shape))
