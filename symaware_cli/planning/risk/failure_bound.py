"""Bounds of the probability that specifications fail, for linear models."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.core import AgentGroup, Model
from symaware_cli.planning.risk.predicate_bounds import NotLinearError, predicate_bound
from symaware_cli.planning.risk.sampled_motion import SampledMotion
from symaware_cli.planning.risk.state_conditions import Moments, StateCondition, Tail, propagated
from symaware_cli.specification import (
    Monitor,
    PredictedAgentScope,
    Specification,
    SpecificationMonitor,
    TruthBounds,
    truth_bounds,
)
from symaware_cli.specification.columns import Lookup
from symaware_cli.specification.formula import Array
from symaware_cli.world import SECOND


class BoundedSpecification(NamedTuple):
    """A specification whose predicates have bounds.

    Attributes:
        monitor: Its monitor.
        predicates: Its predicates.
    """

    monitor: SpecificationMonitor
    predicates: Sequence[StateCondition]


def bounded(specification: Specification, group: AgentGroup) -> list[StateCondition]:
    """Compile the predicates of a specification of the agents of a group.

    Raises:
        NotLinearError: A predicate has no bound, or the specification is of another kind.
    """
    if specification.each is None:
        raise NotLinearError("it is about pairs, of which there are samples only")
    if specification.end is not None or specification.automaton is not None:
        raise NotLinearError("it has an end (`to`), or is in linear temporal logic")
    model = group.model
    varying = {
        "position",
        "state",
        *(quantity.name for quantity in model.state),
        *(["velocity"] * bool(model.velocities)),
    }
    regions = {name: each.region for name, each in specification.scope.regions.items()}
    found = []
    for atom in specification.formulation.atoms:
        try:
            found.append(predicate_bound(atom.node, varying, regions))
        except NotLinearError as error:
            raise NotLinearError(f"`{atom.text}`: {error}") from None
    return found


def is_linear(model: Model) -> bool:
    """Return whether a model is linear in state and control input, with a constant part: at points drawn for it."""
    generator = np.random.Generator(np.random.PCG64(1))
    states, inputs = generator.normal(size=(len(model.state), 3)), generator.normal(size=(len(model.control_input), 3))
    states[:, 2], inputs[:, 2] = states[:, :2].mean(axis=1), inputs[:, :2].mean(axis=1)
    rates = np.array([np.broadcast_to(each, 3) for each in model.derivative(states, inputs, np)], float)
    return bool(np.allclose(rates[:, 2], rates[:, :2].mean(axis=1), rtol=1e-9, atol=1e-9))


def failure_bounds(
    specifications: Sequence[BoundedSpecification],
    group: AgentGroup,
    motion: SampledMotion,
    covariance: Array | None,
    instants: Sequence[int],
    scope: PredictedAgentScope,
    tail: Tail,
) -> Array:
    """Return bounds of the probability that a specification of each agent fails; shape (n,).

    The mean of the state is that of the motion, whose covariance follows from the model (it is linear, as far as
    control inputs are not at their limits) and its process noise. The probabilities of all faces, predicates, instants
    and specifications add up (Boole's inequality).

    Args:
        specifications: The specifications.
        group: The group.
        motion: The expected motion: one sample without noise.
        covariance: The present covariance of the states, shape (n, nx, nx); None if they are known.
        instants: The instants of the prediction [ns].
        scope: The values of names.
        tail: The assumption about the distribution.
    """
    count, size = motion.states.shape
    spread = np.zeros((count, size, size)) if covariance is None else covariance
    found: list[list[list[tuple[Array, Array]]]] = [[[] for _ in each.predicates] for each in specifications]
    for number, instant in enumerate(instants):
        before = motion.states
        motion.advance(instant / SECOND)
        spread = _propagated(motion, before, spread, group.model, number)
        moments = Moments(motion.states, spread, lambda states: _look_up(scope, motion, states))
        for each, of_predicates in zip(specifications, found, strict=True):
            for predicate, so_far in zip(each.predicates, of_predicates, strict=True):
                so_far.append(predicate(moments, tail))
    risk = np.zeros(count)
    for each, of_predicates in zip(specifications, found, strict=True):
        bounds = [
            TruthBounds(np.array([fails for fails, _ in so_far]), np.array([holds for _, holds in so_far]))
            for so_far in of_predicates
        ]
        risk = risk + _of_specification(each.monitor, bounds, instants)
    return np.minimum(risk, 1.0)


def _of_specification(monitor: SpecificationMonitor, future: Sequence[TruthBounds], instants: Sequence[int]) -> Array:
    """Return the bound for each agent: 1 where the specification is violated, else the sum over its instances."""
    specification = monitor.specification
    risk = np.zeros(specification.scope.rows)
    formula = specification.formulation.formula
    for cohort in monitor.cohorts:
        if not isinstance(cohort.monitor, Monitor):
            continue
        undecided = np.flatnonzero(cohort.monitor.verdict == 0)
        past, rows = cohort.monitor.history, cohort.rows[undecided]
        if past is None:
            raise ValueError(f"the past of `{specification.name}` is too long to be kept for a bound")
        predicates = [
            TruthBounds(
                np.concatenate([(known[:, undecided] <= 0.0).astype(float), each.fails[:, rows]]),
                np.concatenate([(known[:, undecided] > 0.0).astype(float), each.holds[:, rows]]),
            )
            for known, each in zip(past, future, strict=True)
        ] or list(future)
        if len(rows):
            total = cohort.monitor.instants + len(instants)
            risk[rows] += truth_bounds(formula, predicates, total, len(rows)).fails[0]
    awaited = np.flatnonzero(monitor.awaited)
    first = next((place for place, instant in enumerate(instants) if instant >= specification.start), None)
    if len(awaited) and first is not None:
        predicates = [TruthBounds(each.fails[first:, awaited], each.holds[first:, awaited]) for each in future]
        risk[awaited] += truth_bounds(formula, predicates, len(instants) - first, len(awaited)).fails[0]
    risk[monitor.verdicts < 0] = 1.0
    return risk


def _propagated(motion: SampledMotion, before: Array, covariance: Array, model: Model, number: int) -> Array:
    """Return the covariance of the states at the present instant."""
    duration = motion.duration
    if duration == 0.0:
        return covariance
    size = covariance.shape[1]
    transition = np.empty(covariance.shape)
    for column, unit in enumerate(np.eye(size)):
        transition[:, :, column] = motion.expected(before + unit)[0] - motion.states
    after, noise = propagated(covariance, transition), model.noise_covariance(duration)
    return after if noise is None else after + noise


def _look_up(scope: PredictedAgentScope, motion: SampledMotion, states: Array) -> Lookup:
    """Return the values of names for states."""
    other = copy.copy(motion)
    other.states = states
    return scope.of(other).look_up
