"""The account of the risk of a run: what it allows, and that no policy violates more often than it promises."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from symaware_cli.planning.risk.risk_budget import RiskBudget

Array = NDArray[np.float64]

RISK, STEPS, RUNS, NOISE = 0.1, 30, 20_000, 0.1


def stopping(places: Array, left: int) -> Array:
    """The risk of standing at distances from a wall for so many steps, and of standing there for one."""
    return np.minimum(1.0, 2 * norm.sf(places / (NOISE * np.sqrt(max(left, 1))))) if left else np.zeros(len(places))


@pytest.mark.parametrize("policy", ["greedy", "paced", "random", "late"])
def test_no_policy_violates_more_often_than_the_account_promises(policy: str) -> None:
    """Walkers that go towards a wall as far as they can afford, and cannot go back: whatever the noise does."""
    generator = np.random.default_rng(7)
    places, budget = np.full(RUNS, 1.0), RiskBudget.whole(RISK, RUNS)
    fallen = np.zeros(RUNS, bool)
    for step in range(STEPS):
        left = STEPS - step
        rest = stopping(places, left)
        allowed = budget.allowed(rest)
        wanted = {
            "greedy": allowed,
            "paced": budget.paced(rest, 5, np.full(RUNS, left)),
            "random": rest + generator.random(RUNS) * (allowed - rest),
            "late": np.where(step < 20, rest, allowed),
        }[policy]
        steps = np.linspace(0.2, 0.0, 41)
        risks = np.array([stopping(places - each, left) for each in steps])
        ahead = steps[(risks <= wanted).argmax(axis=0)]
        assert budget.kept.all() or not step
        planned = stopping(places - ahead, left)
        taken = norm.sf((places - ahead) / NOISE)
        budget = budget.after(rest, planned, taken, np.ones(RUNS, bool))
        places = places - ahead + NOISE * generator.normal(size=RUNS)
        fallen |= places < 0.0
    share = fallen.mean()
    assert share <= RISK + 3 * np.sqrt(RISK * (1 - RISK) / RUNS)
    assert share > RISK / 4


def test_a_plan_that_is_not_followed_loses_what_was_taken() -> None:
    budget = RiskBudget.whole(RISK, 1).after(np.zeros(1), np.full(1, 0.04), np.full(1, 0.01), np.zeros(1, bool))
    assert budget.unused[0] == pytest.approx(RISK - 0.01)
    assert not budget.kept[0]
    assert budget.spent[0] == pytest.approx(0.01)


def test_a_plan_that_is_not_affordable_is_not_kept() -> None:
    budget = RiskBudget.whole(RISK, 1).after(np.full(1, 0.3), np.full(1, 0.2), np.full(1, 0.05), np.ones(1, bool))
    assert budget.unused[0] == pytest.approx(RISK - 0.05)
    assert not budget.kept[0]
