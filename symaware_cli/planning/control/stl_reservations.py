"""Warnings about `control.stl` in a valid scenario: missing guarantees, a short horizon, long searches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.engine import KinematicEnvironment
from symaware_cli.planning.control.stl_horizon import ends
from symaware_cli.planning.control.stl_instances import Instance
from symaware_cli.planning.control.stl_others import ExpectedPositions
from symaware_cli.planning.control.stl_plan import StlParameters
from symaware_cli.planning.control.stl_program import StlPrograms
from symaware_cli.planning.optimal_control.specification_program import ProgramSize
from symaware_cli.specification import Specification
from symaware_cli.specification.formula import horizon
from symaware_cli.world import SECOND

#: [s] CPU time of a search above which there is a warning.
_LONG = 20.0

#: A bound of the number of coefficients in the rows of a predicate at an instant, for each element of the state.
_ENTRIES = 40


def reservations(
    parameters: StlParameters,
    group: AgentGroup,
    specifications: Mapping[str, Specification],
    environment: Environment,
    steps: int,
) -> list[str]:
    """Return sentences about guarantees, the horizon and the computation time.

    Args:
        parameters: The parameters of the component.
        group: The group of the agents that plan.
        specifications: The specifications that they are to satisfy, by name.
        environment: The world.
        steps: The number of steps of the run.
    """
    found = [] if parameters.maximal_risk is None else _not_guaranteed(specifications, environment)
    step, every = environment.time_step, list(specifications.values())
    longest, due_at_end = ends(every)
    due = min(steps if due_at_end else longest, steps)
    given = None if parameters.horizon is None else max(1, round(parameters.horizon * SECOND / step))
    if given is not None and given < due:
        found.append(
            f"plans end after {given * step / SECOND:g} s, and what the specifications require until"
            f" {due * step / SECOND:g} s counts as satisfied; leave `horizon` out to plan for all of it"
        )
    ahead = (due or steps) if given is None else min(given, steps)
    atoms = sum(len(each.formulation.atoms) for each in every)
    most = ProgramSize(1, 0, ahead * (atoms + 1) * _ENTRIES * (len(group.model.state) + 1))
    if most.seconds(parameters.nodes) < _LONG or not len(group):
        return found
    size = _size(parameters, group, every, environment, ahead, steps)
    seconds = size.seconds(parameters.nodes)
    if seconds > _LONG:
        found.append(
            f"a search for a plan may take about {seconds:.0f} s of CPU time: its program over {ahead} steps has"
            f" {size.binaries:,} binary variables and {size.rows:,} rows; a longer `time_step` of the world, shorter"
            f" windows, fewer regions to avoid, a `horizon`, a greater `hold` or `gap`, or fewer `nodes`"
            f" ({parameters.nodes:,}) shorten it"
        )
    return found


def _not_guaranteed(specifications: Mapping[str, Specification], environment: Environment) -> list[str]:
    found = []
    if not isinstance(environment, KinematicEnvironment):
        found.append(
            "`maximal_risk` is not guaranteed: in this world forces move bodies, and the plan takes their motion for"
            " that of the linear model"
        )
    pairs = [name for name, each in specifications.items() if each.each is None]
    if pairs:
        found.append(
            f"`maximal_risk` is not guaranteed for `{pairs[0]}`: others are expected to follow their intents, or to"
            " keep their velocities, which are approximations"
        )
    return found


def _size(
    parameters: StlParameters,
    group: AgentGroup,
    specifications: Sequence[Specification],
    environment: Environment,
    ahead: int,
    steps: int,
) -> ProgramSize:
    """Return the size of the first program of the first agent."""
    instances, others = [], {}
    for each in specifications:
        first = each.start // environment.time_step
        end = horizon(each.formulation.formula)
        last = steps if end is None else first + end
        if each.end is not None:
            last = min(last, each.end // environment.time_step)
        other = "" if each.each is not None else "other"
        if other:
            axes = len(group.model.position)
            still = group.model.positions(np.asarray(group.awareness.state)[:1])
            others[other] = ExpectedPositions(np.repeat(still, ahead + 1, axis=0), np.zeros((ahead + 1, axes, axes)))
        if last > 0:
            instances.append(Instance(each, each.start, first, last, other, ()))
    programs = StlPrograms(parameters, group, environment)
    program = programs.of(instances, 0, group.awareness.state[0], ahead, ahead >= steps, others)
    return program.size
