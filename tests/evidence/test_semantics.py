"""The definitions of the operators, on samples that can be followed by hand."""

import numpy as np
import pytest

from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.specification.formula import (
    Always,
    And,
    Constant,
    Eventually,
    Formula,
    Historically,
    Next,
    Not,
    Once,
    Or,
    Predicate,
    Since,
    Until,
)

X, Y = Predicate(0), Predicate(1)
SAMPLES = [np.array([3.0, -1.0, 4.0, 1.0]), np.array([-5.0, -9.0, 2.0, -6.0])]
INF = np.inf


@pytest.mark.parametrize(
    ("formula", "low", "high"),
    [
        (X, [3, -1, 4, 1], [3, -1, 4, 1]),
        (Not(X), [-3, 1, -4, -1], [-3, 1, -4, -1]),
        (And((X, Y)), [-5, -9, 2, -6], [-5, -9, 2, -6]),
        (Or((X, Y, Constant(False))), [3, -1, 4, 1], [3, -1, 4, 1]),
        (Always(0, None, X), [-1, -1, 1, 1], [-1, -1, 1, 1]),
        (Eventually(0, None, Y), [2, 2, 2, -6], [2, 2, 2, -6]),
        # A window beyond the end needs samples that do not exist.
        (Always(1, 2, X), [-1, 1, -INF, -INF], [-1, 1, 1, INF]),
        (Eventually(1, 2, X), [4, 4, 1, -INF], [4, 4, INF, INF]),
        # At the last instant `next` fails, and `weak next` holds.
        (Next(X), [-1, 4, 1, -INF], [-1, 4, 1, -INF]),
        (Next(X, weak=True), [-1, 4, 1, INF], [-1, 4, 1, INF]),
        (Always(0, None, Next(X)), [-INF] * 4, [-INF] * 4),
        (Always(0, None, Next(X, weak=True)), [-1, 1, 1, INF], [-1, 1, 1, INF]),
        # Instants beyond the end do not exist.
        (Eventually(1, 1, Next(X, weak=True)), [4, 1, INF, -INF], [4, 1, INF, INF]),
        # Left holds until just before the instant at which right holds.
        (Until(0, None, X, Y), [-1, -1, 2, -6], [-1, -1, 2, -6]),
        (Until(0, 1, X, Y), [-5, -1, 2, -6], [-5, -1, 2, 1]),
        (Historically(0, 1, X), [3, -1, -1, 1], [3, -1, -1, 1]),
        (Historically(1, None, X), [INF, 3, -1, -1], [INF, 3, -1, -1]),
        (Once(1, 1, X), [-INF, 3, -1, 4], [-INF, 3, -1, 4]),
        # Left has held since then, including now.
        (Since(0, None, X, Y), [-5, -5, 2, 1], [-5, -5, 2, 1]),
    ],
    ids=repr,
)
def test_operators_follow_their_definitions(formula: Formula, low: list[float], high: list[float]) -> None:
    found = robustness_interval(formula, SAMPLES, 4, 1, ended=True)
    assert found.low[:, 0].tolist() == low
    assert found.high[:, 0].tolist() == high


def test_bounds_of_an_unfinished_run_allow_any_continuation() -> None:
    found = robustness_interval(Always(0, None, X), SAMPLES, 4, 1, ended=False, times=1)
    assert (found.low[0, 0], found.high[0, 0]) == (-INF, -1.0)


def test_an_unfinished_run_may_end_immediately_or_have_a_next_instant() -> None:
    strong, weak = (robustness_interval(Next(X, weak=weak), SAMPLES, 4, 1, ended=False) for weak in (False, True))
    assert (strong.low[:, 0].tolist(), strong.high[:, 0].tolist()) == ([-1, 4, 1, -INF], [-1, 4, 1, INF])
    assert (weak.low[:, 0].tolist(), weak.high[:, 0].tolist()) == ([-1, 4, 1, -INF], [-1, 4, 1, INF])


def test_the_last_instant_of_a_finite_run_has_no_next() -> None:
    found = robustness_interval(Eventually(1, 1, Constant(True)), [], 2, 1, ended=True, cut=True)
    assert found.low[:, 0].tolist() == [INF, -INF]
