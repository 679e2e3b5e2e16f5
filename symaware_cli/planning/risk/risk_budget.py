"""The risk that agents may still take, so that its probability over the whole run stays below a given one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array, Indices, Mask


class RiskBudget(NamedTuple):
    """An account of the risk of violating specifications in the run, for each of n agents.

    An agent always has a plan for the whole rest of the run (or of the windows of its specifications) whose risk it can
    afford, if only to stop and stay. Let a be its allowance, the risk that it may still take; r(p) the risk of a plan,
    given its present knowledge; and p the plan that it keeps. It can use the difference a - r(p), the *unused* risk,
    for riskier plans. With later knowledge, the rest of the plan has another risk r'(p), whose expectation is at most
    r(p) less the risk taken in between; the allowance is then

        a' = (a - r(p)) + r'(p)

    So the sum of the risk taken and of the allowance is at most the maximal risk in expectation, for any choice of
    plans; and the rest of the plan is always affordable. docs/decisions/0053 has the proof.

    Attributes:
        unused: The part of the allowance that no plan has; shape (n,).
        kept: Whether an agent keeps a plan that it can afford; shape (n,).
        spent: The risk taken so far: the sum over steps of the probability of a violation, given the knowledge before
            each; shape (n,).
    """

    unused: Array
    kept: Mask
    spent: Array

    @classmethod
    def whole(cls, maximal: float, count: int) -> RiskBudget:
        """Return the account of agents that have taken no risk and have no plan.

        Args:
            maximal: The maximal risk of each.
            count: The number of agents.
        """
        return cls(np.full(count, maximal), np.zeros(count, bool), np.zeros(count))

    def allowed(self, rest: Array) -> Array:
        """Return the risk that a plan for the rest of the run may have at most; shape (n,).

        Args:
            rest: The risk of the rest of the plan that each agent keeps, or of stopping, if it has none; shape (n,).
        """
        return np.where(self.kept, self.unused + rest, self.unused)

    def paced(self, rest: Array, ahead: int, remaining: Indices) -> Array:
        """Return the risk that a plan should have at most, so that there is some left for later; shape (n,).

        A plan over a part of the remaining run may use that part of the risk; from turn to turn, a plan comes to reach
        one step further. The rest of the plan that is kept is always within it, and stopping, if it is affordable.

        Args:
            rest: As for `allowed`.
            ahead: How many steps plans reach.
            remaining: How many steps to come count; shape (n,).
        """
        first = np.minimum(1.0, ahead / np.maximum(remaining, 1))
        further = 1.0 / np.maximum(remaining - ahead + 1, 1)
        paced = np.where(self.kept, rest + self.unused * further, self.unused * first)
        return np.minimum(np.maximum(paced, rest), self.allowed(rest))

    def after(self, rest: Array, planned: Array, taken: Array, kept: Mask) -> RiskBudget:
        """Return the account when a step of a plan was taken.

        Args:
            rest: As for `allowed`.
            planned: The risk of the plan; shape (n,).
            taken: The risk of its first step; shape (n,).
            kept: Whether the plan is followed; shape (n,). If not, or if it was not affordable, its first step reduces
                the unused risk.
        """
        allowed = self.allowed(rest)
        affordable = kept & (planned <= allowed)
        unused = np.where(affordable, allowed - planned, allowed - taken)
        return RiskBudget(np.maximum(unused, 0.0), affordable, self.spent + taken)
