"""The robustness of formulas on the samples up to now, as if the run ended now."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array, Formula
from symaware_cli.specification.sliding import sliding


def measured(formula: Formula, samples: Sequence[Array], instants: int, rows: int) -> Array:
    """Return the robustness of a formula at each instant, with all windows cut to the instants that are known.

    Of ``eventually`` this is the greatest so far and of ``always`` the least; where nothing of a window is known, they
    are minus infinity and infinity.

    Args:
        formula: The formula.
        samples: Robustness of each predicate [instants, rows].
        instants: Number of instants.
        rows: Number of rows.

    Returns:
        Shape [instants, rows].
    """

    def of(part: Formula) -> Array:
        match part:
            case stl.Constant():
                return np.full((instants, rows), np.inf if part.value else -np.inf)
            case stl.Predicate():
                return samples[part.index][:instants]
            case stl.Not():
                return -of(part.operand)
            case stl.And():
                least: Array = np.minimum.reduce([of(each) for each in part.operands])
                return least
            case stl.Or():
                greatest: Array = np.maximum.reduce([of(each) for each in part.operands])
                return greatest
            case stl.Always() | stl.Historically():
                return window(np.minimum, np.inf, part)
            case stl.Eventually() | stl.Once():
                return window(np.maximum, -np.inf, part)
            case stl.Next():
                beyond = np.full((1, rows), np.inf if part.weak else -np.inf)
                return np.concatenate([of(part.operand)[1:], beyond])
            case stl.Until() | stl.Since():
                return chain(part)

    def window(
        ufunc: np.ufunc, neutral: float, part: stl.Always | stl.Eventually | stl.Historically | stl.Once
    ) -> Array:
        values, first, last = of(part.operand), part.first, _last(part.last)
        if first > last:
            return np.full((instants, rows), neutral)
        beyond = np.full((last, rows), neutral)
        if isinstance(part, stl.Always | stl.Eventually):
            return sliding(ufunc, np.concatenate([values[first:], beyond]), last - first + 1)
        return sliding(ufunc, np.concatenate([beyond, values[: instants - first]]), last - first + 1)

    def chain(part: stl.Until | stl.Since) -> Array:
        left, right, last = of(part.left), of(part.right), _last(part.last)
        if isinstance(part, stl.Since):
            left, right = left[::-1], right[::-1]
        found, before = np.full((instants, rows), -np.inf), np.full((instants, rows), np.inf)
        for ahead in range(last + 1):
            known = instants - ahead
            if isinstance(part, stl.Since) and ahead:
                # What is on the left holds after the instant of what is on the right, up to and including now.
                before[:known] = np.minimum(before[:known], left[ahead - 1 : ahead - 1 + known])
            if ahead >= part.first:
                found[:known] = np.maximum(found[:known], np.minimum(right[ahead:], before[:known]))
            if isinstance(part, stl.Until):
                before[:known] = np.minimum(before[:known], left[ahead:])
        return found[::-1] if isinstance(part, stl.Since) else found

    def _last(last: int | None) -> int:
        return instants - 1 if last is None else min(last, instants - 1)

    return of(formula)
