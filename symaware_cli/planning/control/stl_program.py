"""The programs of `control.stl`: mixed-integer programs of the specifications that an agent still has to satisfy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from symaware_cli.core import AgentGroup, Environment, Model
from symaware_cli.geometry import Array
from symaware_cli.planning.control.stl_chance import Margins
from symaware_cli.planning.control.stl_instances import Instance
from symaware_cli.planning.control.stl_others import ExpectedPositions
from symaware_cli.planning.control.stl_plan import StlParameters
from symaware_cli.planning.optimal_control import (
    Face,
    LinearDynamics,
    SpecificationProgram,
    pair_sets,
    predicate_sets,
    state_names,
)
from symaware_cli.planning.optimal_control.affine_predicate import StateSet
from symaware_cli.planning.optimal_control.formula_tree import PredicateSets
from symaware_cli.specification import Specification
from symaware_cli.world import SECOND, nanoseconds


class StlPrograms:
    """Makes the programs of plans for agents of a group.

    Attributes:
        dynamics: The dynamics over a step of the world.
    """

    uncaptured = "*"  # no state between calls

    def __init__(self, parameters: StlParameters, group: AgentGroup, environment: Environment) -> None:
        """Derive the dynamics.

        Args:
            parameters: The parameters of the component.
            group: The group.
            environment: The environment.
        """
        world = environment.parameters
        self._parameters = parameters
        self._group = group
        self._step = environment.time_step
        self.dynamics = LinearDynamics.of(
            group.model,
            self._step / SECOND,
            getattr(world, "integrator", "exact"),
            int(getattr(world, "substeps", 1)),
        )
        self._lower, self._upper = state_bounds(parameters, group.model)
        self._covariances = self._noise()

    def of(
        self,
        instances: Sequence[Instance],
        row: int,
        state: Array,
        steps: int,
        is_whole: bool,
        others: Mapping[str, ExpectedPositions],
        plain: bool = False,
        margins: Margins | None = None,
    ) -> SpecificationProgram:
        """Return the program of a plan.

        Args:
            instances: The instances of specifications to satisfy.
            row: The row of the agent.
            state: Its state; shape (nx,).
            steps: The number of steps.
            is_whole: Whether these lead to the last instant that counts.
            others: The expected positions of other agents, by id.
            plain: Whether to ask only whether there is a plan.
            margins: The reserves for noise; by default those of the parameter `deviations`.
        """
        parameters = self._parameters
        if margins is None:
            margins = Margins(self.dynamics, self._reduction if self._covariances is not None else None)
        program = SpecificationProgram(
            margins.dynamics,
            state,
            steps,
            hold=parameters.hold,
            lower=self._lower,
            upper=self._upper,
            robustness_weight=0.0 if plain else parameters.robustness_weight,
        )
        for each in instances:
            program.require(
                f"{each.specification.name} {each.other}".strip(),
                each.specification.formulation.formula,
                self._about(each, row, others),
                least=parameters.robustness,
                first=each.first,
                last=each.last,
                past=each.past,
                reduction=margins.reduction,
                open_future=not is_whole,
            )
        if not plain:
            program.add_effort(parameters.effort_weight)
        return program

    def _about(self, instance: Instance, row: int, others: Mapping[str, ExpectedPositions]) -> Sequence[PredicateSets]:
        """Return the states in which predicates of a specification hold, and those in which their negations do."""
        if not instance.other:
            return own_sets(instance.specification, self._group, row)
        formulation, model, id = instance.specification.formulation, self._group.model, instance.other
        at: dict[int, list[tuple[StateSet, StateSet]]] = {}

        def sets(instant: int, index: int) -> tuple[StateSet, StateSet]:
            if id not in others:
                return True, True  # nothing is known, so nothing can be done about it
            if instant not in at:
                mean, covariance = (each[instant] for each in others[id])
                at[instant] = pair_sets(formulation, model, id, mean, covariance)
            return at[instant][index]

        return [partial(sets, index=index) for index in range(len(formulation.atoms))]

    def _noise(self) -> list[Array] | None:
        """Return the covariances of the noise that has added up after some steps; None if there is no noise to heed."""
        noise = self._group.model.noise_covariance(self._step / SECOND)
        if noise is None or not self._parameters.deviations:
            return None
        found, A = [np.zeros_like(noise)], self.dynamics.A
        for _ in range(max(1, round(nanoseconds(self._parameters.noise_horizon) / self._step))):
            found.append(A @ found[-1] @ A.T + noise)
        return found

    def _reduction(self, half_space: Face, instant: int) -> float:
        assert self._covariances is not None
        normal = np.array(half_space.normal)
        covariance = self._covariances[min(instant, len(self._covariances) - 1)]
        variance = float(normal @ covariance @ normal) + half_space.variance
        return float(self._parameters.deviations * np.sqrt(max(0.0, variance)))


def own_sets(specification: Specification, group: AgentGroup, row: int) -> list[tuple[StateSet, StateSet]]:
    """Return the own states in which each predicate of a specification holds, and those in which its negation does.

    Raises:
        ExpressionError: A predicate is not linear.
    """
    return predicate_sets(specification.formulation, state_names(group.model, group.knowledge[row]), group.regions)


def state_bounds(parameters: StlParameters, model: Model) -> tuple[Array, Array]:
    """Return the least and the greatest states that the parameters allow; each of shape (nx,).

    Raises:
        ValueError: A bound names no element of the state, or is not in order.
    """
    names = [quantity.name for quantity in model.state]
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for name, (least, greatest) in parameters.bounds.items():
        if name not in names:
            raise ValueError(f"`bounds` names `{name}`, and the elements of the state are {', '.join(names)}")
        if least >= greatest:
            raise ValueError(f"the bounds of `{name}` are not in order")
        low[names.index(name)], high[names.index(name)] = least, greatest
    return low, high
