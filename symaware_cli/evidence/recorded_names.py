"""Values of the names in specifications, for one row, computed from the recorded states of a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment, seconds
from symaware_cli.engine import Simulation
from symaware_cli.evidence.link_here import link_here
from symaware_cli.evidence.row_evaluator import RegionHere, norm, row_robustness
from symaware_cli.specification import (
    LINK,
    OTHER,
    SELF,
    AbsentError,
    AgentScope,
    AwarenessScope,
    BeliefScope,
    ClosestPairScope,
    PairScope,
    Scope,
    Specification,
    SpecificationError,
)

Array = NDArray[np.float64]


class RecordedNames:
    """Computes values of names from the states, control inputs and knowledge recorded at the present instant."""

    def __init__(self, simulation: Simulation) -> None:
        self._world: Environment = simulation.environment
        self._clock = simulation.clock
        self._groups = simulation.groups
        self._places = {id: (group, row) for group in self._groups for row, id in enumerate(group.ids)}
        regions = self._groups[0].regions if self._groups else {}
        self._regions = {name: RegionHere(name, regions, self._pose) for name in regions}
        self._index = {id: index for index, id in enumerate(self._places)}
        #: The positions of all agents at the instant, NaN for absent agents; shape (agents, d).
        self._positions = np.empty((0, 0))

    def robustness(self, specification: Specification) -> list[Array]:
        """Return the robustness of each predicate of a specification; each of shape (rows,), NaN for absent agents.

        Raises:
            SpecificationError: A predicate has no value.
        """
        scope = specification.scope
        self._positions = np.array([self._positioned(*place) for place in self._places.values()])
        present = np.ones(scope.rows, bool) if scope.present is None else scope.present
        found = [np.full(scope.rows, np.nan) for _ in specification.formulation.atoms]
        shared: dict[str, Any] = {}
        for row in np.flatnonzero(present).tolist():
            look_up = partial(self._value, scope, row, {}, shared)
            for column, atom in zip(found, specification.formulation.atoms, strict=True):
                try:
                    column[row] = row_robustness(atom.node, look_up)
                except AbsentError:
                    column[row] = -np.inf
                except (ValueError, TypeError, LookupError, ArithmeticError) as error:
                    raise SpecificationError(f"`{atom.text}` has no value: {error}") from error
                if np.isnan(column[row]):
                    who = " and ".join(scope.agents(row))
                    raise SpecificationError(f"`{atom.text}` has no value" + (f" for {who}" if who else ""))
        return found

    def _value(self, scope: Scope, row: int, known: dict[str, Any], shared: dict[str, Any], name: str) -> Any:
        """Return the value of a name for a row; `known` caches values of the row, `shared` values of all rows."""
        if name not in known:
            known[name] = self._derived(scope, row, name, shared)
        return known[name]

    def _derived(self, scope: Scope, row: int, name: str, shared: dict[str, Any]) -> Any:
        if name == "time":
            return seconds(self._clock.now)
        if name in self._regions:
            return self._regions[name]
        match scope:
            case BeliefScope():
                return self._believed(scope, row, name, shared)
            case AgentScope():
                state = self._world.state(scope.group)[row]
                return self._of_agent(scope.group, row, state, self._world.applied_input(scope.group)[row], name)
            case AwarenessScope():
                first, second = scope.agents(row)
                return self._of_awareness(first, second, name)
            case PairScope():
                first, second = scope.agents(row)
                return self._of_pair(first, second, name)
            case ClosestPairScope():
                return min(self._least_distance(one, second) for first, second in scope.pairs for one in first)
        return self._of_world(scope, name)

    def _of_agent(self, group: AgentGroup, row: int, state: Array, control_input: Array, name: str) -> Any:
        model = group.model
        places = {quantity.name: place for place, quantity in enumerate(model.state)}
        match name:
            case "control_input":
                return control_input
            case "knowledge":
                return group.knowledge[row]
            case "link" if group.model.links is not None and name not in places:
                return _LinksOfOne(group, state)
            case "nearest":
                return self._least_distance(group.ids[row], [*self._places])
            case "position":
                return state[list(model.position)]
            case "speed" if name not in places:
                return norm(model.velocity(state[None], control_input[None])[0])
            case "state":
                return state
            case "velocity":
                return model.velocity(state[None], control_input[None])[0]
        return float(state[places[name]]) if name in places else group.knowledge[row][name]

    def _believed(self, scope: BeliefScope, row: int, name: str, shared: dict[str, Any]) -> Any:
        """Return a belief, derived from the recorded belief about the own state or looked up in awareness."""
        group = scope.group
        if name == "nearest" or name in group.awareness.columns.keys() - {"state"} or name == "has_intent":
            if name not in shared:
                shared[name] = scope.look_up(name)
            return shared[name][row]
        return self._of_agent(group, row, group.awareness.state[row], group.control_input[row], name)

    def _of_pair(self, first: str, second: str, name: str) -> Any:
        if name in ("distance", "closing_speed"):
            apart = self._position(second) - self._position(first)
            distance = norm(apart)
            if name == "distance":
                return distance
            rate = 0.0
            for along, velocity in zip(apart, self._velocity(second) - self._velocity(first), strict=True):
                rate += along * velocity
            return -rate / distance if distance > 0.0 else 0.0
        values: dict[str, Callable[[str], Any]] = {
            "link": lambda id: _LinksOfOne(*self._place(id), self._world.roster.dimensions),
            "position": self._position,
            "speed": lambda id: norm(self._velocity(id)),
            "velocity": self._velocity,
        }
        return {"first": values[name](first), "second": values[name](second)}

    def _of_awareness(self, id: str, other: str, name: str) -> Any:
        """Return the beliefs of an agent, or the truth, about itself and another; missing beliefs are absent."""
        match name:
            case "truth":
                return {SELF: self._position(id), OTHER: self._position(other)}
            case "true_velocity":
                return {SELF: self._velocity(id), OTHER: self._velocity(other)}
            case "distance" | "closing_speed":
                return self._of_pair(id, other, name)
        group, row = self._places[id]
        is_position = name == "belief"
        state, requested = group.awareness.state[row][None], group.control_input[row][None]
        own = group.model.positions(state) if is_position else group.model.velocity(state, requested)
        database, width = group.agents[row].awareness_database, self._world.roster.dimensions
        motion = database[other].state if other in database else np.full(2 * width, np.nan)
        if name == "known":
            return {OTHER: not np.isnan(motion[:width]).any()}
        found = {SELF: self._padded(own[0])}
        of_other = motion[:width] if is_position else motion[width:]
        if not np.isnan(of_other).any():
            found[OTHER] = of_other
        return _Beliefs(found)

    def _of_world(self, scope: Scope, name: str) -> Any:
        """Return a value about the world, looked up as in a run, except the positions of links."""
        if name == LINK:
            return _LinksByName(self._world, self._groups)
        return _of_one(scope.look_up(name))

    def _least_distance(self, id: str, others: Sequence[str]) -> float:
        """Return the distance of an agent to the nearest of the others; infinite if it or all others are absent."""
        rows = [self._index[each] for each in others if each != id]
        apart = self._positions[rows] - self._position(id)
        squared = np.zeros(len(apart))
        for axis in range(apart.shape[1]):
            squared = squared + apart[:, axis] * apart[:, axis]
        return float(np.sqrt(squared[~np.isnan(squared)]).min(initial=np.inf))

    def _place(self, id: str) -> tuple[AgentGroup, Array]:
        group, row = self._places[id]
        return group, self._world.state(group)[row]

    def _position(self, id: str) -> Array:
        return np.asarray(self._positions[self._index[id]])

    def _positioned(self, group: AgentGroup, row: int) -> Array:
        if group.present is not None and not group.present[row]:
            return np.full(self._world.roster.dimensions, np.nan)
        return self._padded(self._world.state(group)[row][list(group.model.position)])

    def _velocity(self, id: str) -> Array:
        group, row = self._places[id]
        state, applied = self._world.state(group)[row], self._world.applied_input(group)[row]
        return self._padded(group.model.velocity(state[None], applied[None])[0])

    def _padded(self, vector: Array) -> Array:
        """Return a vector with as many coordinates as the world; those that a model does not have are 0."""
        return np.concatenate([vector, np.zeros(self._world.roster.dimensions - len(vector))])

    def _pose(self, id: str) -> tuple[Array, float | None]:
        group, row = self._places[id]
        state, heading = self._world.state(group)[row], group.model.heading
        position = state[list(group.model.position)]
        if group.present is not None and not group.present[row]:
            position = np.full_like(position, np.nan)
        return position, None if heading is None else float(state[heading])


class _LinksOfOne:
    """The positions of the links of one agent by name [m]; each of shape (d,)."""

    def __init__(self, group: AgentGroup, state: Array, dimensions: int = 0) -> None:
        """Store their source data; coordinates up to `dimensions` that the model does not have are 0."""
        self._model = group.model
        self._state = state
        self._dimensions = dimensions

    def __getitem__(self, link: str) -> Array:
        mechanism, links = self._model.mechanism(), self._model.links
        assert links is not None
        posture = mechanism.posture(self._state)
        joints = dict(zip(mechanism.joints, posture.joints, strict=True))
        found = link_here(links.tree, link, joints, posture.position, posture.orientation)
        own = found[: len(self._model.position)]
        return np.array(own + [0.0] * (self._dimensions - len(own)))


class _LinksOfSome:
    """The positions of the links of several agents by name [m]; each of shape (n, d)."""

    def __init__(self, group: AgentGroup, states: Array) -> None:
        self._each = [_LinksOfOne(group, state) for state in states]
        self._dimensions = len(group.model.position)

    def __getitem__(self, link: str) -> Array:
        return np.array([each[link] for each in self._each]).reshape(-1, self._dimensions)


class _LinksByName:
    """The links of each agent by its id, and of the agents of a group that are in the world by its name."""

    def __init__(self, world: Environment, groups: Sequence[AgentGroup]) -> None:
        self._world = world
        self._groups = groups

    def __getitem__(self, name: str) -> _LinksOfOne | _LinksOfSome:
        for group in self._groups:
            if name in group.ids:
                row = group.ids.index(name)
                if group.present is not None and not group.present[row]:
                    raise AbsentError(f"`{name}` is not in the world")
                return _LinksOfOne(group, self._world.state(group)[row])
        for group in self._groups:
            if group.name == name:
                states = self._world.state(group)
                return _LinksOfSome(group, states if group.present is None else states[group.present])
        raise KeyError(f"there is no agent or group `{name}`")


def _of_one(value: Any) -> Any:
    """Return a value of the single row of the world."""
    if isinstance(value, np.ndarray):
        return value[0]
    return value if np.isscalar(value) else _OfOne(value)


class _Beliefs(dict[str, Array]):
    """Beliefs of an agent, by the agent that they are about; a missing one is absent."""

    def __missing__(self, name: str) -> Array:
        raise AbsentError(f"there is no belief about the agent `{name}`")


class _OfOne:
    """A mapping from names of agents or groups to their values, for the single row of the world."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values

    def __getitem__(self, name: str) -> Any:
        return _of_one(self._values[name])
