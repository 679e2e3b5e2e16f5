"""Conditions on a state with a known mean and covariance: bounds of probabilities, and half spaces that keep them.

Many states at a time are *rows*: agents, or stages of a plan.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from symaware_cli.geometry import Array, Faces, ball_faces
from symaware_cli.specification.columns import Lookup

#: What is assumed about the states: that they are normal, or nothing but their mean and covariance.
Tail = Literal["normal", "chebyshev"]


class Moments(NamedTuple):
    """The states at an instant, or at several.

    Attributes:
        mean: Shape (n, nx).
        covariance: Shape (n, nx, nx).
        look_up: Returns the values of a name for states, shape (n, nx).
    """

    mean: Array
    covariance: Array
    look_up: Callable[[Array], Lookup]


class HalfSpaces(NamedTuple):
    """Half spaces of the state x, ``slopes @ x + offsets >= 0``, for each row.

    Attributes:
        slopes: Shape (k, n, nx); 0 where a row has fewer than k half spaces.
        offsets: Shape (k, n); infinite there.
    """

    slopes: Array
    offsets: Array

    def margins(self, mean: Array) -> Array:
        """Return the left side for states (n, nx); shape (k, n)."""
        product: Array = (self.slopes * mean).sum(axis=2)
        return product + self.offsets

    def deviations(self, covariance: Array) -> Array:
        """Return the standard deviation of the left side for covariances (n, nx, nx); shape (k, n)."""
        variance = np.zeros(self.offsets.shape)
        for row in range(covariance.shape[1]):
            for column in range(covariance.shape[1]):
                variance = variance + self.slopes[:, :, row] * covariance[:, row, column] * self.slopes[:, :, column]
        return np.sqrt(np.maximum(variance, 0.0))


class StateCondition(ABC):
    """A condition on the state."""

    def __call__(self, moments: Moments, tail: Tail) -> tuple[Array, Array]:
        """Return bounds of the probabilities that it fails and that it holds; each of shape (n,)."""
        return self.failure(moments, tail), self.failure(moments, tail, holds=False)

    def failure(self, moments: Moments, tail: Tail, holds: bool = True) -> Array:
        """Return a bound of the probability that it fails, or that it does not fail; shape (n,).

        The probabilities of leaving the half spaces add up (Boole's inequality).
        """
        sides = self.half_spaces(moments, holds)
        margins = sides.margins(moments.mean)
        exists = np.isfinite(margins)
        fails = exceeding(np.where(exists, margins, 1.0), sides.deviations(moments.covariance), tail)[0]
        total: Array = np.where(exists, fails, 0.0).sum(axis=0)
        return np.minimum(total, 1.0)

    @abstractmethod
    def half_spaces(self, moments: Moments, holds: bool = True) -> HalfSpaces:
        """Return half spaces in whose intersection it holds, or does not hold; of several, those likeliest to hold."""


class HalfSpace(StateCondition):
    """A margin that is linear in the state is positive."""

    def __init__(self, margin: Callable[[Lookup], Any]) -> None:
        """Create the condition.

        Args:
            margin: Returns the margin, of shape (n,), from the values of names.
        """
        self._margin = margin

    def half_spaces(self, moments: Moments, holds: bool = True) -> HalfSpaces:
        """See the base class."""
        count, size = moments.mean.shape

        def at(states: Array) -> Array:
            return np.broadcast_to(np.asarray(self._margin(moments.look_up(states)), float), (count,))

        origin = at(np.zeros((count, size)))
        slope = np.stack([at(np.broadcast_to(unit, (count, size))) - origin for unit in np.eye(size)], axis=1)
        # From the mean, where the margin is exact.
        offset = at(moments.mean) - (slope * moments.mean).sum(axis=1)
        sign = 1.0 if holds else -1.0
        return HalfSpaces(sign * slope[None], sign * offset[None])


class Conjunction(StateCondition):
    """All of several conditions hold."""

    def __init__(self, parts: Sequence[StateCondition]) -> None:
        self.parts = tuple(parts)

    def half_spaces(self, moments: Moments, holds: bool = True) -> HalfSpaces:
        """See the base class."""
        found = [each.half_spaces(moments, holds) for each in self.parts]
        if holds:
            return HalfSpaces(
                np.concatenate([each.slopes for each in found]), np.concatenate([each.offsets for each in found])
            )
        # One of them has to fail: for each row that which most likely does, of several by the greatest margin.
        rows = np.arange(len(moments.mean))
        scores = np.array([_score(each, moments) for each in found])
        likeliest = scores[:, 0] <= scores[:, 0].min(axis=0)
        safest = np.where(likeliest, scores[:, 1], -np.inf).argmax(axis=0)
        most = max(len(each.offsets) for each in found)
        padded = [_padded(each, most) for each in found]
        slopes = np.stack([each.slopes for each in padded])
        offsets = np.stack([each.offsets for each in padded])
        return HalfSpaces(slopes[safest, :, rows].swapaxes(0, 1), offsets[safest, :, rows].T)


class Polytope(Conjunction):
    """A point that is linear in the state lies in a convex region."""

    def __init__(self, point: Callable[[Lookup], Any], faces: Faces) -> None:
        """Create the condition.

        Args:
            point: Returns the point, of shape (n, d), from the values of names.
            faces: The faces of the region, of d dimensions or fewer.
        """

        def margin(look_up: Lookup, normal: Array, offset: float) -> Any:
            return (point(look_up)[:, : len(normal)] * normal).sum(axis=1) + offset

        super().__init__(
            [HalfSpace(partial(margin, normal=normal, offset=offset)) for normal, offset in zip(*faces, strict=True)]
        )


class Negation(StateCondition):
    """A condition does not hold."""

    def __init__(self, part: StateCondition) -> None:
        self.part = part

    def half_spaces(self, moments: Moments, holds: bool = True) -> HalfSpaces:
        """See the base class."""
        return self.part.half_spaces(moments, not holds)


class InsideDisc(StateCondition):
    """A point that is linear in the state lies in a disc or ball.

    It does at least inside of a polytope in the disc, and at most in the half space that touches the disc towards the
    mean.
    """

    def __init__(self, point: Callable[[Lookup], Any], centre: Array, radius: float) -> None:
        """Create the condition.

        Args:
            point: Returns the point, of shape (n, d), from the values of names.
            centre: The centre [m]; shape (d,) or shorter.
            radius: The radius [m].
        """
        self._point = point
        self._centre = centre
        self._radius = radius
        normals, offsets = ball_faces(len(centre), radius)
        self._inner = Polytope(point, Faces(normals, offsets - normals @ centre))

    def half_spaces(self, moments: Moments, holds: bool = True) -> HalfSpaces:
        """See the base class."""
        return self._inner.half_spaces(moments) if holds else self._touching(moments).half_spaces(moments, False)

    def _touching(self, moments: Moments) -> HalfSpace:
        """Return the half space that contains the disc and touches it towards the mean."""
        point, centre, radius = self._point, self._centre, self._radius
        away = point(moments.look_up(moments.mean))[:, : len(centre)] - centre
        length = np.sqrt((away * away).sum(axis=1))
        normal = np.where(length[:, None] > 0.0, away / np.where(length > 0.0, length, 1.0)[:, None], 0.0)
        return HalfSpace(lambda look_up: radius - (normal * (point(look_up)[:, : len(centre)] - centre)).sum(axis=1))


def exceeding(margin: Array, deviation: Array, tail: Tail) -> tuple[Array, Array]:
    """Return the probabilities that a quantity is negative and that it is positive, or bounds of them.

    Without an assumption about the distribution, by Cantelli's inequality (F. P. Cantelli, "Sui confini della
    probabilita", 1929): a deviation of at least d has a probability of at most v / (v + d^2).

    Args:
        margin: Its mean.
        deviation: Its standard deviation.
        tail: The assumption about its distribution.
    """
    known = deviation <= 1e-12 * (1.0 + np.abs(margin))
    scaled = margin / np.where(known, 1.0, deviation)
    if tail == "normal":
        fails, holds = ndtr(-scaled), ndtr(scaled)
    else:
        square = scaled * scaled
        fails = np.where(scaled > 0.0, 1.0 / (1.0 + square), 1.0)
        holds = np.where(scaled < 0.0, 1.0 / (1.0 + square), 1.0)
    # At a margin of 0 both may be: whether the predicate is strict does not count here.
    return np.where(known, (margin <= 0.0).astype(float), fails), np.where(known, (margin >= 0.0).astype(float), holds)


def propagated(covariance: Array, transition: Array) -> Array:
    """Return A P A' for covariances P and matrices A, (n, nx, nx) each, with bits that depend on no library."""
    size = covariance.shape[1]
    found = np.zeros(covariance.shape)
    for row in range(size):
        for column in range(size):
            for one in range(size):
                for other in range(size):
                    found[:, row, column] += (
                        transition[:, row, one] * covariance[:, one, other] * transition[:, column, other]
                    )
    return found


def quantile(probability: Array, tail: Tail) -> Array:
    """Return how many standard deviations of margin bound the probability of a negative quantity; see `exceeding`."""
    return -ndtri(probability) if tail == "normal" else np.sqrt((1.0 - probability) / probability)


def _score(sides: HalfSpaces, moments: Moments) -> Array:
    """Return the probability of leaving half spaces, and the least margin in standard deviations; shape (2, n)."""
    margins, deviations = sides.margins(moments.mean), sides.deviations(moments.covariance)
    exists = np.isfinite(margins)
    fails = exceeding(np.where(exists, margins, 1.0), deviations, "normal")[0]
    return np.stack([np.where(exists, fails, 0.0).sum(axis=0), (margins / (deviations + 1e-6)).min(axis=0)])


def _padded(sides: HalfSpaces, count: int) -> HalfSpaces:
    """Return as many half spaces as asked for; the added ones contain every state."""
    more = count - len(sides.offsets)
    return HalfSpaces(
        np.pad(sides.slopes, ((0, more), (0, 0), (0, 0))),
        np.pad(sides.offsets, ((0, more), (0, 0)), constant_values=np.inf),
    )
