"""Lane keeping: vehicles drive along the centre lines of their lanes and of successive lanes.

Reasons: docs/decisions/0096-roads.md
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.engine import Steering
from symaware_cli.geometry import LARGEST, Array, Indices, Mask, lengths, wrapped
from symaware_cli.roads.driver_model import Driver, idm_acceleration
from symaware_cli.roads.road_network import LanePlaces, RoadNetwork, UnreadRoads
from symaware_cli.world import SECOND

#: The greatest angle between the heading of an agent and the direction of its lane [rad].
_CROSSWISE = 0.5 * np.pi


class LanePosition(NamedTuple):
    """The positions of agents on the road; shape (n,) each.

    Attributes:
        lane: The index of the lane that each agent keeps to.
        along: The distance along the centre line [m].
        across: The distance from the centre line, positive to the left [m].
        segment: The nearest segment of the centre line.
        speed: The speed of each agent [m/s].
        has_begun: Whether each agent was on the road before.
        places: The position of each agent in each lane.
    """

    lane: Indices
    along: Array
    across: Array
    segment: Indices
    speed: Array
    has_begun: Mask
    places: LanePlaces


class Driving(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control inputs to request; shape (n, nu).
        intent: The positions ahead; shape (n, h, 2).
        lane: The index of the lane to keep to; shape (n,).
        has_ended: Whether each is beyond the end of the last lane of its route; shape (n,).
        further: Further decisions of subclasses.
    """

    control_input: Array
    intent: Array
    lane: Indices
    has_ended: Mask
    further: Any = None


class LaneKeeping(Steering):
    """Drives along the centre line of the lane in which an agent begins, and of successive lanes.

    The curvature of the path is that of the lane, plus a term that turns the vehicle towards the centre line: the
    distance from this line decays like that of a critically damped oscillator, over the distance ``lookahead`` +
    ``lookahead_time`` x speed. Where lanes fork, an agent takes the lane in its knowledge ``route``, a list of lanes,
    or else the first one.

    The speed approaches the knowledge ``desired_speed`` of an agent, or else the parameter ``speed``, limited by the
    speed limit of the lane, as in the intelligent driver model on a free road. An agent begins with the speed in its
    knowledge ``initial_speed``, if it has one. Other agents are ignored. Beyond the end of its last lane it drives
    straight on.
    """

    batchable = True

    events: ClassVar = {
        "road-ended": "An agent came to the end of a lane without a successor.",
    }

    class Parameters(Steering.Parameters):
        """Speed and steering."""

        speed: float | None = Field(
            None, gt=0, le=LARGEST, description="Desired speed [m/s]; by default the speed limit of the lane."
        )
        acceleration: float = Field(1.5, gt=0, le=100, description="Greatest acceleration [m/s^2].")
        braking: float = Field(2.0, gt=0, le=100, description="Comfortable deceleration [m/s^2].")
        hardest: float = Field(9.0, gt=0, le=100, description="Greatest deceleration [m/s^2].")
        lookahead: float = Field(2.0, gt=0, le=1e4, description="Distance in which a standing vehicle would turn [m].")
        lookahead_time: float = Field(0.7, ge=0, le=1e3, description="Additional distance for each m/s of speed [s].")
        steepest: float = Field(
            0.3, gt=0, lt=1.5, description="Greatest angle between the path to the centre line and the lane [rad]."
        )

    def check(self, group: AgentGroup) -> None:
        """Check that there are roads, that agents are on them, and that they have a desired speed."""
        if isinstance(group.sections.get("roads"), UnreadRoads):
            return
        network = self._network_of(group)
        if len(group.model.position) != 2:
            raise ValueError("lanes are in the plane, and the model moves in space")
        desired = self._desired(group)
        without = ~np.isfinite(np.minimum(network.limit[:, None], desired)).all(axis=1)
        if without.any():
            name = network.lanes[int(without.argmax())].name
            raise ValueError(
                f"the lane `{name}` has no speed limit, so agents need a `speed`, or the knowledge `desired_speed`"
            )
        for row in range(len(group)):
            for name in self._route(group, row):
                if name not in network.index:
                    raise ValueError(f"the route of {group.ids[row]} names the lane `{name}`, which does not exist")
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the lanes."""
        super().initialise_component(group)
        given = self.parameters
        self._network = network = self._network_of(group)
        self._driver = self._driver_of(given)
        routes = [self._route(group, row) for row in range(len(group))]
        known = list(dict.fromkeys(routes))
        #: The row of each agent's route in `_following`; shape (n,).
        self._route_of = np.array([known.index(route) for route in routes], np.intp)
        self._following = network.following(known)
        self._rows = np.arange(len(group))
        self._steered = [quantity.name for quantity in group.model.control_input]
        self._lane = np.full(len(group), -1)
        self._present = np.zeros(len(group), bool)
        self._ended = np.zeros(len(group), bool)
        self._before: int | None = None

    @staticmethod
    def _driver_of(given: Any) -> Driver:
        return Driver(0.0, 0.0, given.acceleration, given.braking, given.hardest)

    @staticmethod
    def _network_of(group: AgentGroup) -> RoadNetwork:
        network = group.sections.get("roads")
        if not isinstance(network, RoadNetwork):
            raise ValueError("the scenario has no `roads`")
        return network

    @staticmethod
    def _route(group: AgentGroup, row: int) -> frozenset[str]:
        """Return the lanes that an agent prefers where lanes fork."""
        route = group.knowledge[row].get("route", ())
        if isinstance(route, str) or not all(isinstance(each, str) for each in route):
            raise ValueError("the knowledge `route` of each agent must be a list of names of lanes")
        return frozenset(route)

    def _desired(self, group: AgentGroup) -> Array:
        """Return the desired speed of each agent without a limit [m/s]; shape (n,)."""
        desired = _known_speed(group, "desired_speed")
        if desired is not None:
            return desired
        return np.full(len(group), np.inf if self.parameters.speed is None else self.parameters.speed)

    def _position(self) -> LanePosition:
        """Return the positions of the agents, and the lanes that they keep to by default."""
        group, network = self._group, self._network
        model, state = group.model, group.awareness.state
        position = model.positions(state)
        present = group.in_world
        begun = self._present & present & (self._lane >= 0)
        places = network.places(position)
        lane = np.where(begun, self._lane, self._nearest(places, state))
        for _ in range(_MOST_PASSED):
            along = places.along[self._rows, lane]
            following = self._following[self._route_of, lane]
            # On a circle of one lane the nearest segment after the last is the first.
            passed = (along > network.length[lane]) & (following >= 0) & (following != lane)
            if not passed.any():
                break
            lane = np.where(passed, following, lane)
        velocity = model.velocity(state, model.limit(group.control_input))
        speed = lengths(velocity)
        initial = _known_speed(group, "initial_speed")
        if initial is not None:
            speed = np.where(begun, speed, initial)
        rows = self._rows
        return LanePosition(
            lane,
            places.along[rows, lane],
            places.across[rows, lane],
            places.segment[rows, lane],
            speed,
            begun,
            places,
        )

    def _nearest(self, places: LanePlaces, state: Array) -> Indices:
        """Return the nearest lane of each agent, among lanes in its direction of travel."""
        network, heading = self._network, self._group.model.heading
        beyond = np.maximum(-places.along, places.along - network.length)
        distance = np.abs(places.across) + np.maximum(beyond, 0.0)
        if heading is not None:
            towards = network.heading(places.segment, places.along)
            distance = distance + np.where(np.abs(wrapped(state[:, heading, None] - towards)) > _CROSSWISE, 1e6, 0.0)
        nearest: Indices = distance.argmin(axis=1)
        return nearest

    def _compute(self) -> Driving:
        here = self._position()
        return self._driven(here, here.lane, self._free_acceleration(here))

    def _desired_here(self, lane: Indices) -> Array:
        """Return the desired speed of each agent in a lane [m/s]; shape (n,)."""
        desired: Array = np.minimum(self._desired(self._group), self._network.limit[lane])
        return desired

    def _free_acceleration(self, here: LanePosition) -> Array:
        desired, alone = self._desired_here(here.lane), np.full(len(here.lane), np.inf)
        free = idm_acceleration(here.speed, desired, alone, here.speed, self._driver)
        # Agents brake at most comfortably for speed limits.
        acceleration: Array = np.maximum(free, -self.parameters.braking)
        return acceleration

    def _driven(self, here: LanePosition, lane: Indices, acceleration: Array, further: Any = None) -> Driving:
        """Return the control inputs with which agents keep to lanes at accelerations [m/s^2]."""
        group, network, parameters, rows = self._group, self._network, self.parameters, self._rows
        model, state = group.model, group.awareness.state
        along, across = here.places.along[rows, lane], here.places.across[rows, lane]
        segment = here.places.segment[rows, lane]
        since = self.environment.time_step if self._before is None else self.now - self._before
        before = here.speed
        if self._steered and self._steered[0] == "speed":
            # For a model whose speed follows with a lag, the set point is integrated, not the reached speed.
            before = np.where(here.has_begun, model.limit(group.control_input)[:, 0], before)
        speed = np.maximum(before + np.where(here.has_begun, acceleration, 0.0) * (since / SECOND), 0.0)
        towards = network.heading(segment, along)
        reach = parameters.lookahead + parameters.lookahead_time * here.speed
        aim = np.minimum(np.maximum(-0.5 * across / reach, -parameters.steepest), parameters.steepest)
        control_input = np.empty((len(state), len(self._steered)))
        if self._steered[0] == "speed" and model.heading is not None:
            off = wrapped(state[:, model.heading] - towards)
            curvature = network.curvature(segment) + (2.0 / reach) * (aim - off)
            control_input[:, 0] = speed
            if self._steered[1] == "steering_angle":
                control_input[:, 1] = np.arctan(model.wheelbase * curvature)  # type: ignore[attr-defined]
            else:
                control_input[:, 1] = speed * curvature
        else:
            angle = towards + aim
            velocity = np.stack([speed * np.cos(angle), speed * np.sin(angle)], axis=1)
            control_input[:] = model.follow_velocity(state, velocity)
        ended = (along > network.length[lane]) & (self._following[self._route_of, lane] < 0)
        return Driving(control_input, self._path(lane, along, across, speed, reach), lane, ended, further)

    def _path(self, lane: Indices, along: Array, across: Array, speed: Array, reach: Array) -> Array:
        """Return the positions ahead, at the decaying distance from the centre of the lane; (n, h, 2)."""
        network = self._network
        travelled = speed[:, None] * self._ahead
        places, lanes = along[:, None] + travelled, np.broadcast_to(lane[:, None], travelled.shape)
        for _ in range(_MOST_PASSED):
            following = self._following[self._route_of[:, None], lanes]
            passed = (places > network.length[lanes]) & (following >= 0)
            if not passed.any():
                break
            places = np.where(passed, places - network.length[lanes], places)
            lanes = np.where(passed, following, lanes)
        points, ahead = network.at(lanes, places)
        share = travelled / reach[:, None]
        off = across[:, None] * (1.0 + share) * np.exp(-share)
        return points + off[..., None] * np.stack([-ahead[..., 1], ahead[..., 0]], axis=2)

    def _update(self, value: Driving) -> None:
        self._steer(value.control_input, value.intent)
        group = self._group
        present = group.in_world
        for row in np.flatnonzero(present & value.has_ended & ~(self._ended & self._present)).tolist():
            name = self._network.lanes[int(value.lane[row])].name
            self.emit_for(row, "road-ended", f"came to the end of the lane {name}")
        self._lane, self._present, self._ended = value.lane, present.copy(), value.has_ended
        self._before = self.computed_at


#: The greatest number of lanes that an agent passes in a turn, or within its intent.
_MOST_PASSED = 8


def _known_speed(group: AgentGroup, name: str) -> Array | None:
    """Return a speed in the knowledge of each agent [m/s], shape (n,); None if no agent has one.

    Raises:
        ValueError: A value is not a speed.
    """
    if not any(name in known for known in group.knowledge):
        return None
    speeds = group.known(name)
    if speeds.shape != (len(group),) or (speeds < 0.0).any():
        raise ValueError(f"the knowledge `{name}` of each agent must be a speed, at least 0 [m/s]")
    return speeds
