"""Tubes: how far a robot may be from its plan, and the probability that it is farther away."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

#: What is known of the error: its covariance alone, or that it is normal.
TubeKind = Literal["chebyshev", "gaussian"]


@dataclass(frozen=True, slots=True)
class Tube:
    """Radii of a tube in the plane, and a bound of the risk of each.

    The error e of a plan has mean zero and the covariance alpha I. The risk of a radius rho is a bound of
    P(|e| > rho): 2 alpha / rho^2 by the inequality of Chebyshev, or exp(-rho^2 / (2 alpha)) if e is normal. Both are
    convex between `least` and `greatest`, so that the greatest of several chords lies above them: such a bound is part
    of a linear program.

    Attributes:
        kind: ``chebyshev`` or ``gaussian``.
        variance: alpha [m^2].
        least: The least radius [m].
        greatest: The greatest radius [m], whose risk is the least one.
        chords: Pairs of a and b: risk >= a + b rho, with b in 1/m.
    """

    kind: TubeKind
    variance: float
    least: float
    greatest: float
    chords: tuple[tuple[float, float], ...]

    @classmethod
    def of(
        cls, kind: TubeKind, variance: float, least_risk: float, chords: int = 1, widest: float | None = None
    ) -> Tube:
        """Return the tube whose widest radius has a given risk, or a given radius if that is less.

        Args:
            kind: ``chebyshev`` or ``gaussian``.
            variance: alpha, the variance of the error in each direction [m^2].
            least_risk: The risk of the greatest radius, between 0 and 0.6.
            chords: The number of chords.
            widest: The greatest radius allowed [m].

        Raises:
            ValueError: The greatest radius allowed is not above the least one.
        """
        bound = _bound(kind, variance)
        if kind == "chebyshev":
            least, greatest = math.sqrt(2.0 * variance), math.sqrt(2.0 * variance / least_risk)
        else:
            # Below this radius the bound is not convex.
            least, greatest = math.sqrt(variance), math.sqrt(-2.0 * variance * math.log(least_risk))
        greatest = greatest if widest is None else min(greatest, widest)
        if greatest <= least:
            raise ValueError(f"the tube is at least {least:.3g} m wide, and at most {greatest:.3g} m are allowed")
        ratio = greatest / least
        ends = [least * ratio ** (place / chords) for place in range(chords)] + [greatest]
        pairs = []
        for left, right in pairwise(ends):
            slope = (bound(right) - bound(left)) / (right - left)
            pairs.append((bound(right) - slope * right, slope))
        return cls(kind, variance, least, greatest, tuple(pairs))

    @property
    def least_risk(self) -> float:
        """The risk of the greatest radius, which no step goes below."""
        return _bound(self.kind, self.variance)(self.greatest)

    def probability(self, radius: float) -> float:
        """Return the bound of the probability that the error exceeds a radius [m]."""
        return min(1.0, _bound(self.kind, self.variance)(radius))

    def risk(self, radius: float) -> float:
        """Return the risk of a radius [m] in a program: the chords, which lie above the bound."""
        return max(a + b * radius for a, b in self.chords)


def _bound(kind: TubeKind, variance: float) -> Callable[[float], float]:
    if kind == "chebyshev":
        return lambda radius: 2.0 * variance / (radius * radius)
    return lambda radius: math.exp(-radius * radius / (2.0 * variance))
