"""The reference path of `control.mpc`: to the goal, via waypoints and around obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.control.mpc_problem import Tracking, weights_of
from symaware_cli.components.control.mpc_route import Route, Routes
from symaware_cli.core import Model
from symaware_cli.world.arrays import real

Array = NDArray[np.float64]


def goal_of(knowledge: Mapping[str, Any], model: Model, weights: Tracking) -> Array:
    """Return the knowledge ``goal`` of an agent: a position, shape (d,), or a whole state, shape (nx,).

    Raises:
        ValueError: It is neither, or a position where an angle has a weight.
    """
    try:
        goal = real(knowledge["goal"])
    except (TypeError, ValueError):
        goal = np.empty(0)
    if goal.shape not in ((len(model.position),), (len(model.state),)):
        raise ValueError(
            f"the knowledge `goal` of each agent must be a position of {len(model.position)} numbers, or a state of "
            f"{len(model.state)}"
        )
    if len(goal) < len(model.state):
        of = weights_of(model, weights)
        for element in model.angles:
            if of.state[element] or of.terminal[element]:
                raise ValueError(f"a weight of `{model.state[element].name}` needs a `goal` that is a whole state")
    return goal


def waypoints_of(knowledge: Mapping[str, Any], dimensions: int) -> Array:
    """Return the knowledge ``waypoints`` to pass before the goal; shape (w, d), empty without any.

    Raises:
        ValueError: They are not positions.
    """
    known = knowledge.get("waypoints")
    if known is None:
        return np.empty((0, dimensions))
    try:
        places = real(known)
    except (TypeError, ValueError):
        places = np.empty(0)
    if places.ndim != 2 or places.shape[1] != dimensions:
        raise ValueError(f"the knowledge `waypoints` of each agent must be a list of positions of {dimensions} numbers")
    return places


class ReferencePath:
    """The path of one agent to its goal, as a reference of its state."""

    def __init__(self, model: Model, goal: Array, waypoints: Array, routes: Routes | None) -> None:
        """Construct the path.

        Args:
            model: The model of the agent.
            goal: A position, shape (d,), or a whole state, shape (nx,).
            waypoints: Positions to pass before the goal; shape (w, d).
            routes: Routes around obstacles; None for straight lines.
        """
        self._model = model
        self._position = list(model.position)
        self._target = np.zeros(len(model.state))
        self._target[self._position if len(goal) < len(self._target) else slice(None)] = goal
        self._goal = self._target[self._position]
        self._given = goal
        self._waypoints = waypoints
        targets = [*waypoints, self._goal]
        self._routes = [routes.to(target) if routes else None for target in targets]
        #: The corners from each target to the goal; each of shape (c, d).
        self._onwards = [self._goal[None]]
        for target, following in zip(reversed(targets[:-1]), reversed(self._routes[1:]), strict=True):
            self._onwards.insert(0, np.concatenate([target[None], _around(target, following), self._onwards[0]]))

    def leads_to(self, goal: Array, waypoints: Array) -> bool:
        """Return whether it leads to this goal, via these waypoints."""
        return np.array_equal(self._given, goal) and np.array_equal(self._waypoints, waypoints)

    def remaining(self, position: Array) -> float:
        """Return the distance of the goal from a position [m]."""
        return float(np.sqrt(np.square(self._goal - position).sum()))

    def passed(self, position: Array, passed: int, within: float) -> int:
        """Return the updated number of passed waypoints: one more if the next is near enough."""
        if passed < len(self._waypoints):
            away = self._waypoints[passed] - position
            return passed + int(np.square(away).sum() <= within * within)
        return passed

    def is_behind(self, passed: int) -> bool:
        """Return whether a number of passed waypoints is all of them."""
        return passed == len(self._waypoints)

    def ahead(self, position: Array, passed: int, travelled: Array) -> Array:
        """Return the reference positions along the shortest path.

        Args:
            position: The position of the agent [m]; shape (d,).
            passed: The number of waypoints passed.
            travelled: The distance along the path at each stage [m]; shape (N + 1,).

        Returns:
            Shape (N + 1, d).
        """
        corners = np.concatenate([position[None], _around(position, self._routes[passed]), self._onwards[passed]])
        legs = np.sqrt(np.square(np.diff(corners, axis=0)).sum(axis=1))
        passing = np.concatenate([[0.0], np.cumsum(legs)])
        return np.stack([np.interp(travelled, passing, axis) for axis in corners.T], axis=1)

    def reference(self, state: Array, places: Array) -> Array:
        """Return the reference states.

        Elements other than the position are those of the goal if that is a whole state, else zero; angles differ from
        the present ones by at most half a turn.

        Args:
            state: The present state of the agent; shape (nx,).
            places: The reference positions [m]; shape (N + 1, d).

        Returns:
            Shape (N + 1, nx).
        """
        target = self._target.copy()
        for element in self._model.angles:
            target[element] += 2 * np.pi * np.round((state[element] - target[element]) / (2 * np.pi))
        reference = np.broadcast_to(target, (len(places), len(target))).copy()
        reference[:, self._position] = places
        return reference


def turned_right(places: Array, angle: float) -> Array:
    """Turn positions (N + 1, d) clockwise about the first of them by an angle [rad], seen from above."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = (places[:, :2] - places[0, :2]).T
    turned = places.copy()
    turned[:, 0], turned[:, 1] = places[0, 0] + cosine * x + sine * y, places[0, 1] + cosine * y - sine * x
    return turned


def _around(position: Array, route: Route | None) -> Array:
    """Return the corners to pass on the route from a position; shape (c, d)."""
    return np.empty((0, len(position))) if route is None else route.by_way_of(position)
