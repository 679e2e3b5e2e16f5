"""The optimal control problem of `control.mpc`: tracks a reference and avoids other agents and obstacles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import casadi
import numpy as np
from pydantic import Field

from symaware_cli.core import Model, Parameters, Quantity
from symaware_cli.geometry import Array
from symaware_cli.planning.optimal_control import Dynamics, OptimalControlProblem

_Weight = Annotated[float, Field(ge=0)]

#: One weight for all elements, one for each in order, or some by name; elements without a name have 0.
Weights = _Weight | list[_Weight] | dict[str, _Weight]


#: [m^2] Added to squared distances, so that the distance is differentiable at 0.
_ROUND = 1e-8


#: The price of leaving a half space by one unit of the state, for each stage: a way to stay is found if there is one.
_FACE_PENALTY = 1e4


class Tracking(Parameters):
    """The costs of `control.mpc`."""

    state_weight: Weights | None = Field(
        None,
        description="Weight of the squared deviation of each element of the state from its reference, at each stage; "
        "one number, a list in the order of the state, or numbers by name. 1 for the position if null.",
    )
    terminal_weight: Weights | None = Field(
        None, description="The same at the end of the horizon; five times `state_weight` if null."
    )
    input_weight: Weights = Field(
        0.01, description="Weight of the square of each element of the control input, likewise."
    )
    change_weight: Weights = Field(
        0.1, description="Weight of the squared change of each element from one stage to the next, likewise."
    )
    penalty: Annotated[float, Field(gt=0)] | None = Field(
        1000.0,
        description="Price of coming closer than the margin, for each stage, where all of the distance to keep is used "
        "up. If null it is never done, and where it cannot be helped there is no new plan.",
    )


class Sizes(NamedTuple):
    """The numbers of agents and obstacles that the problem has constraints for.

    Attributes:
        others: Agents to avoid.
        discs: Obstacles that are discs.
        sides: Obstacles that are represented by half-planes.
        faces: Half spaces of the state that chance constraints keep.
    """

    others: int
    discs: int
    sides: int
    faces: int = 0


class WeightsOf(NamedTuple):
    """The weights of a model, in the order of its state or control input."""

    state: Array
    terminal: Array
    input: Array
    change: Array


def weights_of(model: Model, given: Tracking) -> WeightsOf:
    """Return the weights of all elements.

    Raises:
        ValueError: A weight is for an element that the model does not have.
    """
    if given.state_weight is None:
        state = np.zeros(len(model.state))
        state[list(model.position)] = 1.0
    else:
        state = _spread("state_weight", given.state_weight, model.state)
    terminal = 5.0 * state
    if given.terminal_weight is not None:
        terminal = _spread("terminal_weight", given.terminal_weight, model.state)
    return WeightsOf(
        state,
        terminal,
        _spread("input_weight", given.input_weight, model.control_input),
        _spread("change_weight", given.change_weight, model.control_input),
    )


def _spread(what: str, given: Weights, quantities: Sequence[Quantity]) -> Array:
    names = [quantity.name for quantity in quantities]
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                raise ValueError(f"`{what}` is for `{name}`, and the model has {', '.join(names)}")
        return np.array([given.get(name, 0.0) for name in names])
    if isinstance(given, list):
        if len(given) != len(names):
            raise ValueError(f"`{what}` has {len(given)} numbers, and the model has {', '.join(names)}")
        return np.array(given)
    return np.full(len(names), given)


def tracking_problem(dynamics: Dynamics, steps: int, given: Tracking, sizes: Sizes) -> OptimalControlProblem:
    """Formulate the problem.

    Its parameters are, at each stage, the ``reference`` of the state, the positions of ``others`` and ``discs`` if
    there are any, with the distances to keep ``others_keep`` and ``discs_keep``, and the normals of the ``sides``
    divided by the distance to keep, with the offsets ``sides_offset`` in units of it, and the ``faces`` of half spaces
    of the state with their ``faces_offset``.

    Args:
        dynamics: The discrete dynamics.
        steps: The number of steps of the horizon.
        given: The weights and the penalty.
        sizes: The numbers of constraints.
    """
    model = dynamics.model
    problem = OptimalControlProblem(
        model, steps=steps, time_step=dynamics.step, integrator=dynamics.integrator, substeps=dynamics.substeps
    )
    weights = weights_of(model, given)
    deviation = problem.state - problem.parameter("reference", len(model.state), per_stage=True)
    problem.add_cost(
        _weighted(weights.state, deviation)
        + _weighted(weights.input, problem.control_input)
        + _weighted(weights.change, problem.control_input - problem.previous_input)
    )
    problem.add_terminal_cost(_weighted(weights.terminal, deviation))
    position = problem.state[list(model.position)]

    def apart(name: str, count: int, dimensions: int) -> list[Any]:
        places = problem.parameter(name, (dimensions, count), per_stage=True)
        keep = problem.parameter(f"{name}_keep", count)
        # Distances, as their squares are flat where bodies overlap; rounded, as the root has no slope at 0.
        squares = [casadi.sumsqr(position[:dimensions] - places[:, n]) + _ROUND for n in range(count)]
        return [casadi.sqrt(square) / keep[n] for n, square in enumerate(squares)]

    if sizes.others:
        clear = casadi.vertcat(*apart("others", sizes.others, len(model.position)))
        problem.add_constraint(clear, lower=1.0, penalty=given.penalty)
    obstacles = apart("discs", sizes.discs, 2) if sizes.discs else []
    if sizes.sides:
        normals = problem.parameter("sides", (2, sizes.sides), per_stage=True)
        offsets = problem.parameter("sides_offset", sizes.sides, per_stage=True)
        obstacles += [1.0 + casadi.dot(normals[:, n], position[:2]) - offsets[n] for n in range(sizes.sides)]
    if obstacles:
        # A separate slack: pressure by other agents must not let an agent pass through a wall for the same price.
        problem.add_constraint(casadi.vertcat(*obstacles), lower=1.0, penalty=given.penalty)
    if sizes.faces:
        faces = problem.parameter("faces", (len(model.state), sizes.faces), per_stage=True)
        least = problem.parameter("faces_offset", sizes.faces, per_stage=True)
        problem.add_constraint(casadi.mtimes(faces.T, problem.state) - least, lower=0.0, penalty=_FACE_PENALTY)
    return problem


def _weighted(weights: Array, column: Any) -> Any:
    """Return the weighted sum of squares over the elements with a weight."""
    some = np.flatnonzero(weights).tolist()
    return casadi.dot(weights[some], column[some] ** 2) if some else casadi.SX(0)
