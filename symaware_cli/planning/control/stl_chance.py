"""Chance constraints of `control.stl`: plans whose specifications fail with a bounded probability.

A plan has states z and control inputs v. It is followed with linear feedback, u = v + K (b - z), where b is the
believed state. For a linear model with noise of known covariance, the covariance of the deviation x - z at each instant
follows from that, so that the probability of leaving a half space is exact for normal noise. A specification fails at
most if the state leaves one of the half spaces of the alternatives that were chosen, or if a control input reaches its
limit: the sum of these probabilities is a bound (Boole's inequality; L. Blackmore, M. Ono, B. C. Williams,
"Chance-constrained optimal path planning with obstacles", IEEE Transactions on Robotics 27(6), 2011). Half spaces that
limit the plan get the risk that others do not use (M. Ono, B. C. Williams, "Iterative risk allocation", IEEE Conference
on Decision and Control, 2008).

Specifications about pairs are kept by half spaces that move with the other agent. Their probabilities are those of the
difference of both positions, and each of the two agents may take half of the risk of a pair.

While a plan is followed, the sum of the spent risk and of its remaining risk, given the present state, is a martingale.
So a new plan may have the remaining risk of the last one plus the part of the greatest risk that this left unassigned:
the run then fails with at most the greatest risk, for any number of plans.

Reasons: docs/decisions/0054-risk-of-plans-for-specifications.md
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from symaware_cli.geometry import Array, Indices
from symaware_cli.planning.optimal_control import Face, LinearDynamics, SpecificationPlan, SpecificationProgram
from symaware_cli.planning.optimal_control.formula_tree import Leaf
from symaware_cli.planning.risk.state_conditions import Tail, exceeding, quantile

#: Costs of control inputs from which the feedback is chosen: the first that leaves enough room for plans.
_FEEDBACK_COSTS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 1e4, 1e5)

#: The part of the range of a control input that feedback may take, to either side.
_FEEDBACK_RANGE = 0.15

#: The part of the risk that is for control inputs at their limits.
_INPUT_RISK = 0.05

#: The part of the risk of a pair that each of its two agents may take.
_SHARE_OF_PAIR = 0.5

#: How many programs a search solves at most, with margins for different shares of the risk.
_ATTEMPTS = 5

#: How often the risk is allocated anew at most, after a search; the part of unused risk that remains where it is not
#: used; and from which part of its risk on a half space limits the plan.
_REALLOCATIONS = 3
_REMAINING = 0.3
_LIMITING = 0.95

#: Below this, deviations count as known for sure, and margins may be negative by rounding [units of the state].
_KNOWN = 1e-9
_ROUNDING = 1e-7


class ChosenSides(NamedTuple):
    """The half spaces in which a plan keeps the state.

    Attributes:
        normals: Shape (k, nx).
        offsets: Shape (k,).
        instants: The instant of each, in steps from the beginning of the plan on; shape (k,).
        variances: The variance of each offset, as far as that is where another agent is; shape (k,).
        around: The other agent that each moves with; empty if it stays.
    """

    normals: Array
    offsets: Array
    instants: Indices
    variances: Array
    around: tuple[str, ...]

    @classmethod
    def of(cls, leaves: Sequence[Leaf], size: int) -> ChosenSides:
        """Return half spaces at instants, of states with `size` elements."""
        normals = np.array([each.half_space.normal for each in leaves]).reshape(len(leaves), size)
        offsets = np.array([each.half_space.offset for each in leaves])
        variances = np.array([each.half_space.variance for each in leaves])
        around = tuple(each.half_space.around for each in leaves)
        return cls(normals, offsets, np.array([each.instant for each in leaves], np.intp), variances, around)

    def after(self, stage: int) -> ChosenSides:
        """Return those of later instants than one, counted from that one."""
        later = np.flatnonzero(self.instants > stage)
        around = tuple(self.around[place] for place in later.tolist())
        return ChosenSides(
            self.normals[later], self.offsets[later], self.instants[later] - stage, self.variances[later], around
        )

    @property
    def weights(self) -> Array:
        """The factor of the probability of leaving each: above 1 for pairs, as each agent takes a part of the risk."""
        return np.array([1.0 / _SHARE_OF_PAIR if each else 1.0 for each in self.around])


class Margins(NamedTuple):
    """The reserves of a plan for noise.

    Attributes:
        dynamics: The dynamics, with limits of control inputs that leave a reserve for feedback.
        reduction: Returns the reduction of the margin of a half space at an instant; None for no reduction.
    """

    dynamics: LinearDynamics
    reduction: Callable[[Face, int], float] | None


class RemainingRisk(NamedTuple):
    """The risk of following a plan.

    Attributes:
        total: A bound of the probability that a specification fails at an instant to come.
        following: The part of it that concerns the next instant.
    """

    total: float
    following: float


class Deviations(NamedTuple):
    """The deviations of the state from a plan that is followed, from the present on.

    Attributes:
        gain: The feedback K; shape (nu, nx).
        transition: The matrix of a step of deviations with feedback; shape (nx, nx).
        states: The covariance of x - z; shape (N + 1, nx, nx).
        inputs: The covariance of u - v; shape (N + 1, nu, nu).
    """

    gain: Array
    transition: Array
    states: Array
    inputs: Array

    def of_sides(self, sides: ChosenSides) -> Array:
        """Return the standard deviation across each half space; shape (k,)."""
        covariances = self.states[sides.instants]
        variance = np.einsum("ki,kij,kj->k", sides.normals, covariances, sides.normals)
        found: Array = np.sqrt(np.maximum(variance + sides.variances, 0.0))
        return found


class StlChance:
    """The chance constraints of one agent."""

    uncaptured: ClassVar[Collection[str]] = "*"  # no state between calls

    def __init__(self, dynamics: LinearDynamics, noise: Array | None, greatest: float, tail: Tail) -> None:
        """Prepare.

        Args:
            dynamics: The dynamics over a step of the world.
            noise: The covariance of the noise of a step, shape (nx, nx); None without noise.
            greatest: The greatest risk.
            tail: The assumption about the distribution of the noise.
        """
        self._dynamics = dynamics
        self._noise = np.zeros(dynamics.A.shape) if noise is None else noise
        self._greatest = greatest
        self._tail: Tail = tail
        units = np.eye(len(dynamics.least))
        rows = np.concatenate([units, -units, dynamics.normals])
        limits = np.concatenate([dynamics.greatest, -dynamics.least, dynamics.limits])
        self._input_rows, self._input_limits = rows[np.isfinite(limits)], limits[np.isfinite(limits)]
        self._known: tuple[bytes, Deviations] | None = None

    def search(
        self,
        program: Callable[[Margins], SpecificationProgram],
        solve: Callable[[SpecificationProgram], SpecificationPlan],
        steps: int,
        allowed: float,
        believed: Array,
    ) -> tuple[SpecificationPlan, ChosenSides | None, float]:
        """Return a plan with little enough risk, its half spaces and its risk; or the failed search.

        All half spaces get the same share of the risk: the largest one if all are needed or, if there is no such plan,
        more. The risk of a plan is then computed from the plan itself, not from the shares.

        Args:
            program: Makes a program.
            solve: Solves a program.
            steps: The number of steps to plan.
            allowed: The greatest risk.
            believed: The covariance of the belief; shape (nx, nx).
        """
        deviations = self.deviations(steps, believed)
        bare = program(Margins(self._dynamics, None))
        least, most = (1.0 - _INPUT_RISK) * allowed / max(1, bare.most_required), allowed
        found, share = None, least
        for attempt in range(_ATTEMPTS):
            share = (least, most)[attempt] if attempt < 2 else float(np.sqrt(least * most))
            found = solve(program(self.margins(steps, allowed, share, believed)))
            if found.states is None or found.inputs is None:
                if found.status != "infeasible" or share == most:
                    return found, None, 0.0
                least = share
                continue
            leaves = self._chosen(bare, found.states, deviations)
            risk = self._total(deviations, leaves, found)
            if risk <= allowed:
                return self._reallocated(program, bare, found, leaves, share, allowed, deviations)
            most = share
        assert found is not None
        return SpecificationPlan("infeasible", None, None, {}, found.solution), None, 0.0

    def _reallocated(
        self,
        program: Callable[[Margins], SpecificationProgram],
        bare: SpecificationProgram,
        found: SpecificationPlan,
        leaves: Sequence[Leaf],
        share: float,
        allowed: float,
        deviations: Deviations,
    ) -> tuple[SpecificationPlan, ChosenSides, float]:
        """Return the best plan with the same alternatives, if the risk is allocated to half spaces where it is of use.

        Args:
            program: Makes a program.
            bare: The program without margins.
            found: The plan, with little enough risk.
            leaves: Its half spaces.
            share: The risk that was allocated to each of them.
            allowed: The greatest risk of all.
            deviations: The deviations from a plan.
        """
        assert found.states is not None
        assert found.inputs is not None
        steps, size = len(found.inputs), found.states.shape[1]
        limits = self._tightened(deviations, allowed, steps)
        best, sides, last = (found, leaves), ChosenSides.of(leaves, size), found
        parts = np.full(len(leaves), share)
        for _ in range(_REALLOCATIONS):
            assert last.states is not None
            risks = self._leaving(sides, last.states, deviations)
            limiting = risks >= _LIMITING * parts
            if not limiting.any() or limiting.all():
                break
            parts = np.where(limiting, parts, _REMAINING * parts + (1.0 - _REMAINING) * risks)
            spare = max(0.0, (1.0 - _INPUT_RISK) * allowed - float(parts.sum()))
            parts = np.where(limiting, parts + spare / limiting.sum(), parts)
            given = dict(zip(leaves, parts.tolist(), strict=True))
            again = program(Margins(limits, self._reduction(deviations, share, given))).solve_as_chosen(found.states)
            if again.states is None:
                break
            last, chosen = again, self._chosen(bare, again.states, deviations)
            cost = again.solution.cost
            if cost < best[0].solution.cost and self._total(deviations, chosen, again) <= allowed:
                solution = replace(again.solution, bound=min(found.solution.bound, cost), nodes=found.solution.nodes)
                best = replace(again, status=found.status, solution=solution), chosen
        return best[0], ChosenSides.of(best[1], size), self._total(deviations, best[1], best[0])

    def _total(self, deviations: Deviations, leaves: Sequence[Leaf], plan: SpecificationPlan) -> float:
        """Return the risk of a plan that keeps the state in some half spaces."""
        assert plan.states is not None
        assert plan.inputs is not None
        sides = ChosenSides.of(leaves, plan.states.shape[1])
        return self._risk(deviations, sides, plan.states, plan.inputs, 0).total

    def margins(self, steps: int, allowed: float, share: float, believed: Array) -> Margins:
        """Return the margins of a plan.

        Args:
            steps: Its number of steps.
            allowed: The greatest risk of all.
            share: The greatest risk of each half space.
            believed: The covariance of the belief; shape (nx, nx).
        """
        deviations = self.deviations(steps, believed)
        return Margins(self._tightened(deviations, allowed, steps), self._reduction(deviations, share))

    def remaining(
        self, sides: ChosenSides, states: Array, inputs: Array, stage: int, state: Array, believed: Array
    ) -> tuple[Array, RemainingRisk]:
        """Return the control input with which a plan is followed, and the risk of the rest of the plan.

        Args:
            sides: The half spaces of the plan.
            states: The states of the plan; shape (N + 1, nx).
            inputs: Its control inputs; shape (N, nu).
            stage: The present instant, in steps from its beginning on.
            state: The believed state; shape (nx,).
            believed: Its covariance; shape (nx, nx).
        """
        deviations = self.deviations(len(inputs), believed)
        rest, follows = states[stage:].copy(), inputs[stage:].copy()
        off = state - rest[0]
        for step in range(len(rest)):
            rest[step] += off
            if step < len(follows):
                follows[step] += deviations.gain @ off
            off = deviations.transition @ off
        return follows[0], self._risk(deviations, sides.after(stage), rest, follows, 1)

    def deviations(self, steps: int, believed: Array) -> Deviations:
        """Return the deviations from a plan that begins now, with the feedback for plans of so many steps.

        Args:
            steps: The number of steps.
            believed: The covariance of the belief; shape (nx, nx).
        """
        key = believed.tobytes() + steps.to_bytes(8, "little")
        if self._known is None or self._known[0] != key:
            self._known = key, self._with_feedback(believed, steps)
        return self._known[1]

    # Feedback

    def _with_feedback(self, believed: Array, steps: int) -> Deviations:
        """Return the deviations with the strongest feedback that leaves enough room for plans."""
        for cost in _FEEDBACK_COSTS:
            found = self._propagated(_feedback(self._dynamics, cost), believed, steps)
            reserve = self._reserve(found, self._greatest, steps)
            ranges = self._dynamics.greatest - self._dynamics.least
            units = len(ranges)
            if (reserve[:units] <= _FEEDBACK_RANGE * np.where(np.isfinite(ranges), ranges, np.inf)).all():
                return found
        return self._propagated(np.zeros(self._dynamics.B.T.shape), believed, steps)

    def _propagated(self, gain: Array, believed: Array, steps: int) -> Deviations:
        """Return covariances with a feedback, if the covariance of the belief stays constant."""
        A, transition = self._dynamics.A, self._dynamics.A + self._dynamics.B @ gain
        predicted = A @ believed @ A.T + self._noise
        states, inputs = [believed], [np.zeros((len(gain), len(gain)))]
        off = np.zeros(believed.shape)  # of the believed state from the plan
        for _ in range(steps):
            total = transition @ off @ transition.T + predicted
            off = _positive(total - believed) if believed.any() else total
            states.append(total)
            inputs.append(gain @ off @ gain.T)
        return Deviations(gain, transition, np.array(states), np.array(inputs))

    def _reserve(self, deviations: Deviations, allowed: float, steps: int) -> Array:
        """Return what feedback needs of the limit of each row of control inputs."""
        variance = np.einsum("ri,kij,rj->rk", self._every_row, deviations.inputs[:steps], self._every_row).max(axis=1)
        share = _INPUT_RISK * allowed / max(1, steps * len(self._input_limits))
        reserve: Array = quantile(np.array(share), self._tail) * np.sqrt(np.maximum(variance, 0.0))
        return reserve

    @property
    def _every_row(self) -> Array:
        units = np.eye(len(self._dynamics.least))
        return np.concatenate([units, self._dynamics.normals])

    def _tightened(self, deviations: Deviations, allowed: float, steps: int) -> LinearDynamics:
        """Return the dynamics with the control inputs that feedback leaves to the plan."""
        reserve, count = self._reserve(deviations, allowed, steps), len(self._dynamics.least)
        middle = 0.5 * (self._dynamics.least + self._dynamics.greatest)
        middle = np.where(np.isfinite(middle), middle, 0.0)
        return replace(
            self._dynamics,
            least=np.minimum(self._dynamics.least + reserve[:count], middle),
            greatest=np.maximum(self._dynamics.greatest - reserve[:count], middle),
            limits=np.maximum(self._dynamics.limits - reserve[count:], 0.0),
        )

    # Risks

    def _reduction(
        self, deviations: Deviations, share: float, parts: Mapping[Leaf, float] | None = None
    ) -> Callable[[Face, int], float]:
        """Return by how much margins are reduced, for a share of the risk or, for some half spaces, their parts."""
        given = parts or {}

        def reduction(half_space: Face, instant: int) -> float:
            normal = np.array(half_space.normal)
            variance = float(normal @ deviations.states[instant] @ normal) + half_space.variance
            deviation = float(np.sqrt(max(0.0, variance)))
            part = given.get(Leaf(half_space, instant), share) * (_SHARE_OF_PAIR if half_space.around else 1.0)
            return deviation * float(quantile(np.array(part), self._tail))

        return reduction

    def _chosen(self, program: SpecificationProgram, states: Array, deviations: Deviations) -> list[Leaf]:
        """Return the half spaces of the alternatives of a plan that fail with the least probability."""
        leaves = program.leaves
        risks = self._leaving(ChosenSides.of(leaves, states.shape[1]), states, deviations)
        return program.cheapest(dict(zip(leaves, risks.tolist(), strict=True)))

    def _leaving(self, sides: ChosenSides, states: Array, deviations: Deviations) -> Array:
        margins = (sides.normals * states[sides.instants]).sum(axis=1) + sides.offsets
        leaving: Array = sides.weights * self._failing(margins, deviations.of_sides(sides))
        return leaving

    def _failing(self, margins: Array, deviations: Array) -> Array:
        known = deviations <= _KNOWN
        fails = exceeding(margins, np.where(known, 1.0, deviations), self._tail)[0]
        return np.where(known, (margins < -_ROUNDING).astype(float), fails)

    def _risk(
        self, deviations: Deviations, sides: ChosenSides, states: Array, inputs: Array, first: int
    ) -> RemainingRisk:
        """Return the risk of a plan from its first state on; `first` is the first stage whose input is not known."""
        leaving = self._leaving(sides, states, deviations)
        ahead = inputs[first:]
        margins = self._input_limits - ahead @ self._input_rows.T
        covariances = deviations.inputs[first : len(inputs)]
        variance = np.einsum("ri,kij,rj->kr", self._input_rows, covariances, self._input_rows)
        limited = self._failing(margins, np.sqrt(np.maximum(variance, 0.0)))
        total = float(leaving.sum() + limited.sum())
        following = float(leaving[sides.instants == 1].sum() + limited[:1].sum())
        return RemainingRisk(min(1.0, total), min(1.0, following))


def _feedback(dynamics: LinearDynamics, cost: float) -> Array:
    """Return the gain of the linear quadratic regulator, for unit weights of the state and a cost of inputs."""
    A, B = dynamics.A, dynamics.B
    size, count = B.shape
    worth: Any = np.eye(size)
    gain: Any = np.zeros((count, size))
    for _ in range(200):
        gain = -np.linalg.solve(cost * np.eye(count) + B.T @ worth @ B, B.T @ worth @ A)
        closed = A + B @ gain
        worth = np.eye(size) + cost * gain.T @ gain + closed.T @ worth @ closed
    found: Array = gain
    return found


def _positive(covariance: Array) -> Array:
    """Return the nearest covariance that is not negative in any direction."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    found: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return found
