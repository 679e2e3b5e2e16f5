"""The planar world: rigid bodies in a plane, moved by Pymunk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import pymunk
from numpy.typing import NDArray
from pydantic import Field
from pymunk import batch

from symaware_cli.core import Drive, Entity, EntityGroup, Obstacle, Shape, WorldError
from symaware_cli.geometry import Array, Indices, Pieces, separation
from symaware_cli.worlds.contact_tracker import Pair, pair
from symaware_cli.worlds.joint import Joint, make_joints
from symaware_cli.worlds.physics import BodyStates, OpaqueEngine, PhysicsEnvironment

#: [m] How deep resting bodies may overlap, so that they stay in contact; Pymunk's own 0.1 is meant for pixels.
_SLOP = 5e-4

#: [m] Smaller overlaps at the start count as touching only.
_TINY = 1e-9

#: [m] Radius that a body without a shape has for its inertia.
_POINT = 0.1

_POSE = batch.BodyFields.POSITION | batch.BodyFields.ANGLE | batch.BodyFields.VELOCITY
_POSE |= batch.BodyFields.ANGULAR_VELOCITY
_MOTION = batch.BodyFields.VELOCITY | batch.BodyFields.ANGULAR_VELOCITY
_FORCE = batch.BodyFields.FORCE | batch.BodyFields.TORQUE
_HIT = batch.ArbiterFields.BODY_A_ID | batch.ArbiterFields.BODY_B_ID | batch.ArbiterFields.IS_FIRST_CONTACT
_HIT |= batch.ArbiterFields.TOTAL_IMPULSE | batch.ArbiterFields.NORMAL
_HIT |= batch.ArbiterFields.POINT_A_1 | batch.ArbiterFields.POINT_B_1 | batch.ArbiterFields.DISTANCE_1

_Component = Annotated[float, Field(ge=-1e9, le=1e9)]


class PymunkEnvironment(OpaqueEngine, PhysicsEnvironment):
    """Rigid bodies in a plane that push, rub and bounce off each other, by Pymunk (Chipmunk2D).

    The plane is seen from above, so there is no gravity unless the scenario has some.
    """

    dimensions = 2

    class Parameters(PhysicsEnvironment.Parameters):
        """Parameters of the planar world."""

        gravity: tuple[_Component, _Component] = Field(
            (0.0, 0.0), description="Acceleration of free bodies [x, y] [m/s^2]; agents follow their models instead."
        )
        iterations: int = Field(
            10, ge=1, le=1000, description="Number of iterations over all contacts in a physics step."
        )
        joints: dict[str, Joint] = Field(default_factory=dict, description="Joints between bodies, by name.")

    @property
    def gravity(self) -> Sequence[float] | None:
        """The gravity of a plane seen from the side; None for one seen from above."""
        x, y = self.parameters.gravity
        return (x, y, 0.0) if x or y else None

    def _build(self) -> None:
        """Create bodies in a fixed order: agents, free entities, entities with a path, and static ones."""
        parameters = self.parameters
        space = self._space = pymunk.Space()
        space.iterations = parameters.iterations
        space.collision_slop = _SLOP
        space.gravity = parameters.gravity
        space.damping = 1.0 - parameters.damping
        self._buffer, self._wrench = batch.Buffer(), batch.Buffer()
        self._indices: dict[int, int] = {}
        self._hit = False
        #: The bodies whose outline is one circle, which touches any other body at one point.
        self._discs: set[int] = set()
        self._ended: list[Pair] = []
        self._named: dict[str, pymunk.Body] = {}
        positions, headings = self._initial_poses()
        for actuator, _, part in self._parts:
            entity = actuator.group.entity
            for row in range(part.start, part.stop):
                moment = _moment(entity) if actuator.turns else float("inf")
                body = pymunk.Body(entity.mass, moment)
                body.position, body.angle = tuple(positions[row].tolist()), float(headings[row])
                if actuator.adds:
                    body.velocity = tuple(self._velocity[row, :2].tolist())
                self._add(int(self._driven[row]), body, entity.shape, entity)
                self._inertia[row, -1] = moment / self.step_time if actuator.turns else 0.0
        first = len(self.roster)
        index = {name: first + number for number, name in enumerate(self.obstacles)}
        for name in self._free:
            obstacle = self.obstacles[name]
            body = pymunk.Body(obstacle.mass or 0.0, _moment(obstacle))
            body.velocity, body.angular_velocity = _flat(obstacle.velocity or (0.0, 0.0)), obstacle.turn_rate
            self._place_obstacle(index[name], body, obstacle)
        self._movers = [
            (
                self._place_obstacle(index[name], pymunk.Body(body_type=pymunk.Body.KINEMATIC), self.obstacles[name]),
                name,
            )
            for name in self._moving
        ]
        for name, obstacle in self.obstacles.items():
            if not obstacle.is_free and not obstacle.path:
                self._place_obstacle(index[name], pymunk.Body(body_type=pymunk.Body.STATIC), obstacle)
        constraints = make_joints(parameters.joints, self._named, space.static_body)
        space.add(*constraints)
        self._jointed = bool(constraints)
        dynamic = len(self._driven) + len(self._free)
        #: Forces and torques of a physics step, for all bodies that Pymunk traverses; shape (dynamic and more, 3).
        self._wrenches = np.zeros((dynamic + len(self.obstacles), 3))
        self._wrench.set_float_buf(self._wrenches)
        # Gravity is for free bodies; the forces on agents compensate it.
        self._compensation = np.zeros((len(self._driven), 3))
        self._compensation[:, :2] = -np.array(parameters.gravity) * self._inertia[:, :2] * self.step_time
        self._retained = (1.0 - parameters.damping) ** self.step_time
        # Chipmunk moves bodies by the velocities of the physics step before, and then applies forces.
        self._lag = self.step_time
        self._pushes = bool(self._compensation.any())
        space.on_collision(begin=self._on_begin, separate=self._on_separate)

    def drive(self, group: EntityGroup) -> Drive:
        """Return the limits; a joint is one that cannot be stated."""
        for name, joint in self.parameters.joints.items():
            if not set(group.ids).isdisjoint(each for each in joint.between if each):
                raise WorldError("a joint holds the body", "environment", "with", "joints", name)
        return super().drive(group)

    def _initial_poses(self) -> tuple[Array, Array]:
        """Return initial positions and headings of the agents, and set their initial `_velocity`."""
        positions, headings = np.zeros((len(self._driven), 2)), np.zeros(len(self._driven))
        for actuator, number, part in self._parts:
            model, state = actuator.group.model, self._states[number]
            positions[part] = state[:, model.position]
            if model.heading is not None:
                headings[part] = state[:, model.heading]
            if model.velocities:
                self._velocity[part, :2] = state[:, model.velocities]
        return positions, headings

    def _place_obstacle(self, index: int, body: pymunk.Body, obstacle: Obstacle) -> pymunk.Body:
        pose = obstacle.pose()
        body.position, body.angle = _flat(pose.position), pose.heading
        self._add(index, body, obstacle.shape, obstacle)
        return body

    def _add(self, index: int, body: pymunk.Body, shape: Shape | None, surface: Entity | Obstacle) -> None:
        shapes = [_shape(body, core, radius) for core, radius in (shape.pieces if shape else ())]
        for each in shapes:
            each.friction, each.elasticity = surface.friction, surface.elasticity
            each.owner = index
            # The group lets a ray pass through the body that casts it; parts of one body never collide anyway.
            each.filter = pymunk.ShapeFilter(group=index + 1)
        if len(shapes) == 1 and isinstance(shapes[0], pymunk.Circle):
            self._discs.add(index)
        self._indices[body.id] = index
        self._named[self._tracker.names[index]] = body
        # Shapes outside of the space do not affect others, not even the order in which pairs are solved.
        there = self.present is None or index >= len(self.roster) or self.present[index]
        self._space.add(body, *(shapes if there else ()))

    def _body(self, row: int) -> pymunk.Body:
        return self._named[self.roster.ids[self._driven[row]]]

    def _appear(self, row: int, velocity: Sequence[float]) -> None:
        body = self._body(row)
        body.velocity = velocity[0], velocity[1]
        self._space.add(*body.shapes)

    def _vanish(self, row: int) -> None:
        body = self._body(row)
        body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
        self._velocity[row] = 0.0
        self._space.remove(*(shape for shape in body.shapes if shape.space is not None))

    def close(self) -> None:
        """Remove everything from the space."""
        space = self.__dict__.pop("_space", None)
        if space is not None:
            space.on_collision(begin=pymunk.empty_callback, separate=pymunk.empty_callback)
            space.remove(*space.constraints, *space.shapes, *space.bodies)

    def _refresh(self) -> None:
        self._velocity = self._rows(_MOTION, 3)[: len(self._driven)].copy()

    def _push(self, forces: Array | None) -> None:
        wrenches = self._wrenches[: len(self._driven)]
        wrenches[:] = 0.0 if forces is None else forces
        if self._pushes:
            wrenches += self._compensation
        batch.set_space_bodies(self._space, _FORCE, self._wrench)

    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        step, step_time, tracker = self._space.step, self.step_time, self._tracker
        while True:
            for body, name in self._movers:
                self._move_along_path(body, name, number)
            step(step_time)
            number += 1
            if self._hit or tracker.fresh:
                self._report_contacts()
            if self._ended:
                # After new contacts, so that a body that slides along a wall from part to part stays in contact.
                for bodies in self._ended:
                    tracker.end(bodies)
                self._ended.clear()
            diverted = self._jointed or tracker.agents > 0
            if diverted or number == last:
                return number, diverted

    def _move_along_path(self, body: pymunk.Body, name: str, number: int) -> None:
        """Give an entity with a path the velocity that brings it to the path's pose after this physics step."""
        course = self._course(name, number)
        body.position, body.angle = _flat(course.position), course.heading
        body.velocity, body.angular_velocity = _flat(course.velocity), course.turn_rate

    def _read_driven(self) -> BodyStates:
        if not len(self._driven):
            return BodyStates(np.empty((0, 2)), np.empty(0), np.empty((0, 3)))
        # Pymunk reads all bodies in one call.
        driven, self._free_known = self._read_both()
        return driven

    def _read_free(self) -> BodyStates:
        return self._read_both()[1]

    def _read_both(self) -> tuple[BodyStates, BodyStates]:
        rows = self._rows(_POSE, 6)[: len(self._driven) + len(self._free)].copy()
        driven, free = (
            BodyStates(part[:, :2], part[:, 2], part[:, 3:])
            for part in (rows[: len(self._driven)], rows[len(self._driven) :])
        )
        return driven, free

    def _displace(self, row: int, moved: Array, turned: float, faster: Array) -> None:
        body = self._body(row)
        body.position += pymunk.Vec2d(*moved.tolist())
        body.angle += turned
        body.velocity += pymunk.Vec2d(*faster.tolist())
        self._space.reindex_shapes_for_body(body)

    def _placement(self) -> Mapping[str, Array]:
        return {"bodies": self._rows(_POSE, 6)[: len(self._driven) + len(self._free)].copy()}

    def _place(self, placement: Mapping[str, Array]) -> None:
        space = self._space
        ids = [*(self.roster.ids[index] for index in self._driven.tolist()), *self._free]
        for name, (x, y, angle, *motion) in zip(ids, placement["bodies"].tolist(), strict=True):
            body = self._named[name]
            body.position, body.angle = (x, y), angle
            body.velocity, body.angular_velocity = (motion[0], motion[1]), motion[2]
            space.reindex_shapes_for_body(body)
        for body, name in self._movers:
            pose = self.pose(name)
            body.position, body.angle = _flat(pose.position), pose.heading
            space.reindex_shapes_for_body(body)

    def _rows(self, fields: batch.BodyFields, width: int) -> Array:
        """Return fields of all bodies, a row for each; callers must copy it before the next call."""
        self._buffer.clear()
        batch.get_space_bodies(self._space, fields, self._buffer)
        return np.frombuffer(self._buffer.float_buf()).reshape(-1, width)

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure rays against the shapes of the engine."""
        distances = np.full(directions.shape[:2], np.inf)
        starts = origins[:, :2].tolist()
        ends = (origins[:, None, :2] + reach * directions).tolist()
        query = self._space.segment_query_first
        for row, sender in enumerate(senders.tolist()):
            others, start = pymunk.ShapeFilter(group=sender + 1), starts[row]
            hits = [query(start, end, 0.0, others) for end in ends[row]]
            distances[row] = [np.inf if hit is None else hit.alpha * reach for hit in hits]
        return distances

    def _find_overlaps(self) -> None:
        """Report overlaps, measured here: Pymunk reports no depth for bodies at the same position."""
        near = []
        for shape in self._space.shapes:
            if shape.body is not None and shape.body.body_type == pymunk.Body.DYNAMIC:
                others = self._space.bb_query(shape.bb, pymunk.ShapeFilter(group=shape.owner + 1))
                near += [(shape, other) for other in others if shape.owner != other.owner]
        if not near:
            return
        found = separation(*(Pieces.of(_outline(each) for each in side) for side in zip(*near, strict=True)))
        middles = 0.5 * (found.first + found.second)
        overlaps = [
            (pair(one.owner, other.owner), distance, tuple(middle))
            for (one, other), distance, middle in zip(near, found.distance.tolist(), middles.tolist(), strict=True)
            if distance < -_TINY
        ]
        for bodies, distance, point in sorted(overlaps):
            self._tracker.start(bodies, point, -distance)

    def _on_begin(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        self._hit = True

    def _on_separate(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        one, other = arbiter.shapes
        self._ended.append(pair(one.owner, other.owner))

    def _report_contacts(self) -> None:
        """Report the contacts that began in the last physics step, and their impulses, to the tracker."""
        self._buffer.clear()
        batch.get_space_arbiters(self._space, _HIT, self._buffer)
        numbers = np.frombuffer(self._buffer.int_buf(), np.uintp).reshape(-1, 3)
        hits = np.frombuffer(self._buffer.float_buf()).reshape(-1, 9)
        # The engine orders them by memory address, and sums of floats depend on the order: sort.
        if self._hit:
            self._hit = False
            begun = numbers[:, 2].nonzero()[0]
            self._report_begun(sorted(zip(self._pairs(numbers[begun]), hits[begun].tolist(), strict=True)))
        fresh = self._tracker.fresh
        if fresh:
            pairs = enumerate(self._pairs(numbers))
            for bodies, row in sorted((bodies, hits[row, :4].tolist()) for row, bodies in pairs if bodies in fresh):
                self._tracker.add_impulse(bodies, _impulse(row))

    def _pairs(self, numbers: NDArray[np.uintp]) -> list[Pair]:
        index = self._indices
        return [pair(index[one], index[other]) for one, other in numbers[:, :2].tolist()]

    def _report_begun(self, parts: list[tuple[Pair, list[float]]]) -> None:
        """Report contacts that begin; that of a disc has all of its impulse in its first physics step."""
        found: dict[Pair, tuple[tuple[float, float], float, float]] = {}
        for bodies, hit in parts:
            a_x, a_y, b_x, b_y, gap = hit[4:]
            point, depth, impulse = (0.5 * (a_x + b_x), 0.5 * (a_y + b_y)), max(0.0, -gap), _impulse(hit)
            if bodies in found:
                # If several parts touch, the deepest contact supplies the point.
                point, depth = max((depth, point), found[bodies][1::-1])[::-1]
                impulse += found[bodies][2]
            found[bodies] = point, depth, impulse
        for bodies, _ in parts:
            point, depth, impulse = found[bodies]
            self._tracker.begin(bodies, point, depth, impulse if self._discs.intersection(bodies) else None)


def _impulse(hit: Sequence[float]) -> float:
    """Return the normal impulse between two bodies in a physics step [N s]."""
    by_x, by_y, along_x, along_y = hit[:4]
    return abs(by_x * along_x + by_y * along_y)


def _shape(body: pymunk.Body, core: Sequence[Sequence[float]], radius: float) -> Any:
    """Create one convex piece of a body's outline."""
    if len(core) == 1:
        return pymunk.Circle(body, radius, _flat(core[0]))
    if len(core) == 2:
        return pymunk.Segment(body, _flat(core[0]), _flat(core[1]), radius)
    return pymunk.Poly(body, [_flat(corner) for corner in core], None, radius)


def _flat(position: Sequence[float]) -> tuple[float, float]:
    """Return the coordinates in the plane."""
    return position[0], position[1]


def _moment(entity: Entity | Obstacle) -> float:
    """Return the moment of inertia about the position, which is assumed to be the centre of mass [kg m^2]."""
    assert entity.mass is not None
    if entity.shape is None:
        return pymunk.moment_for_circle(entity.mass, 0.0, _POINT)
    ((core, radius),) = entity.shape.pieces
    if len(core) == 1:
        return pymunk.moment_for_circle(entity.mass, 0.0, radius)
    return pymunk.moment_for_poly(entity.mass, [_flat(corner) for corner in core], (0.0, 0.0), radius)


def _outline(shape: Any) -> tuple[Sequence[Sequence[float]], float]:
    """Return a piece of a body in world coordinates, in the form of `Shape.pieces`."""
    if isinstance(shape, pymunk.Circle):
        core = [shape.offset]
    else:
        core = [shape.a, shape.b] if isinstance(shape, pymunk.Segment) else shape.get_vertices()
    return [shape.body.local_to_world(corner) for corner in core], shape.radius
