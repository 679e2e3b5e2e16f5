"""The spatial world: rigid bodies in space, moved by PyBullet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import (
    AgentGroup,
    Entity,
    Image,
    Obstacle,
    Parameters,
    Scenery,
    Vehicle,
    WorldError,
    seconds,
)
from symaware_cli.core.articulation import Articulation
from symaware_cli.core.rotation import attitude_columns, continued, yaws
from symaware_cli.core.vehicle import read_bodies
from symaware_cli.environments import collision, sight
from symaware_cli.environments.bullet import MOST_SHOWN, Client, engine, quiet
from symaware_cli.environments.collision import Collisions
from symaware_cli.environments.drive import Drive
from symaware_cli.environments.likeness import likenesses
from symaware_cli.environments.physics import Bodies, PhysicsEnvironment
from symaware_cli.environments.posture import Postures
from symaware_cli.environments.solid import Solids, last, turn

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_Component = Annotated[float, Field(ge=-1e9, le=1e9)]

_NOBODY = Bodies(np.empty((0, 3)), np.empty(0), np.empty((0, 4)))

#: [kg] and [kg m^2]: what nothing moves or tilts, and the engine can still compute with.
_IMMOVABLE = 1e9


class Ground(Parameters):
    """A plane that everything falls on."""

    height: float = Field(0.0, ge=-1e9, le=1e9, description="Where it is [m].")
    friction: float = Field(1.0, ge=0, description="Coefficient of friction, times that of what lies on it.")
    elasticity: float = Field(1.0, ge=0, le=1, description="Elasticity, times that of what falls on it.")


class PyBulletEnvironment(PhysicsEnvironment):
    """Rigid bodies in space that fall, push, rub and bounce off each other, by PyBullet.

    The z axis points upwards. Agents of models that move in a plane stand upright at one height, and the ground does
    not touch them.
    """

    dimensions = 3
    provides = ("images",)

    class Parameters(PhysicsEnvironment.Parameters):
        """How the spatial world moves."""

        gravity: tuple[_Component, _Component, _Component] = Field(
            (0.0, 0.0, -9.81),
            description="Acceleration of free bodies and of vehicles [x, y, z] [m/s^2]; other agents follow their "
            "models instead.",
        )
        ground: Ground | None = Field(Ground(), description="The plane that everything falls on; none if null.")
        height: float = Field(1.0, gt=0, description="How high what has no height of its own is, such as a wall [m].")
        recovery: float = Field(
            0.02,
            ge=0,
            le=1,
            description="Part of an overlap that a physics step undoes. It adds energy to collisions: 0 is exact, and "
            "then what overlaps stays so.",
        )
        iterations: int = Field(50, ge=1, le=1000, description="How often a physics step goes over all contacts.")
        visuals: bool = Field(
            False,
            description="Whether URDF files are loaded with what the bodies look like, for pictures; a racecar takes "
            "3 MB for that, and else a twentieth.",
        )
        gui: bool = Field(False, description="Whether to show the window of PyBullet; it needs a screen.")

    def _drive(self, group: AgentGroup, seed: int) -> Drive | None:
        return super()._drive(group, seed) if group.model.vehicle() is None else None

    def _build(self) -> None:
        """Bodies come in a fixed order: the ground, agents, and entities by name."""
        parameters = self.parameters
        count = len(self.roster) + len(self.obstacles)
        if parameters.gui and count > MOST_SHOWN:
            raise WorldError(
                f"the window of PyBullet shows at most {MOST_SHOWN:,} bodies, and there are {count:,}",
                *("environment", "with", "gui"),
            )
        self._client = Client(parameters.gui)
        client = self._id = self._client.id
        self._client.set(self.step_time, parameters.gravity, parameters.iterations, parameters.recovery)
        self._fall = np.array([*parameters.gravity, 0.0]) * self.step_time
        self._falls = bool(self._fall.any())
        self._pushes = self._falls or any(drive is None for drive in self._drives)
        pictures = parameters.gui or parameters.visuals
        self._loading = 0 if pictures else engine.URDF_IGNORE_VISUAL_SHAPES
        self._index: dict[int, int] = {}
        self._frames: dict[int, tuple[Sequence[float], Sequence[float]]] = {}
        self.ground = parameters.ground.height if parameters.ground else None
        self._solids = Solids(client, self.folder, parameters.height, self.ground, self._loading)
        self._postures = Postures(client)
        if parameters.ground:
            shape = engine.createCollisionShape(engine.GEOM_PLANE, physicsClientId=client)
            plane = self._solids.body(0.0, shape, (0.0, 0.0, parameters.ground.height), 0.0)
            self._finish(plane, len(self.roster) + len(self.obstacles), parameters.ground, collision.GROUND)
        self._vehicles: list[tuple[Vehicle, int]] = []
        self._agents = [-1] * len(self._driven)
        #: The rows of those whom something can divert.
        self._row_of: dict[int, int] = {}
        self._headings = np.zeros(len(self._driven))
        self._heights = np.zeros(len(self._driven))
        self._planar = np.zeros(len(self._driven), bool)
        parts = {number: part for _, number, part in self._parts}
        for number, group in enumerate(self.groups):
            if number in parts:
                self._add_driven(group, self._states[number], parts[number])
            else:
                self._add_vehicles(group, number)
        first = len(self.roster)
        for index, (name, obstacle) in enumerate(self.obstacles.items()):
            self._add_obstacle(first + index, name, obstacle)
        vehicles = {self.groups[number].name: vehicle for vehicle, number in self._vehicles}
        self._articulations = likenesses(self.groups, self.obstacles, vehicles, self.folder, parameters.height)
        self._drifts = bool(self._planar.any())
        self._free_headings = np.array([self.obstacles[name].heading for name in self._free])
        self._body_of = {index: body for body, index in self._index.items()}
        ground = len(self.roster) + len(self.obstacles)
        self._collisions = Collisions(client, self._index, self._touches, ground, self.step_time)
        self._painted = False
        owned: dict[int, list[int]] = {}
        for body, index in self._index.items():
            owned.setdefault(index, []).append(body)
        spans = [self._solids.span(owned[first + number]) for number in range(len(self.obstacles))]
        self._scenery = Scenery(self.obstacles, 0, dict(zip(self.obstacles, spans, strict=True)))

    # -- bodies

    def _add_driven(self, group: AgentGroup, state: Array, part: slice) -> None:
        model, entity = group.model, group.entity
        turns, planar = model.heading is not None, len(model.position) == 2
        where = ("agents", group.name, "entity")
        for row, own in zip(range(part.start, part.stop), state, strict=True):
            position = own[list(model.position)].tolist()
            if planar:
                position.append(self._solids.standing(entity.shape))
            heading = float(own[model.heading]) if model.heading is not None else 0.0
            body = self._solids.make(entity.mass, entity.shape, position, heading, *where)
            inertia = self._solids.moment(body, entity)
            turning = inertia if turns else _IMMOVABLE
            # What is driven stays upright: nothing tilts it.
            upright = [_IMMOVABLE, _IMMOVABLE, turning]
            engine.changeDynamics(body, -1, mass=entity.mass, localInertiaDiagonal=upright, physicsClientId=self._id)
            self._finish(
                body, int(self._driven[row]), entity, collision.UPRIGHT if planar else collision.FREE, damping=0.0
            )
            if model.velocities:
                self._velocity[row, : len(model.velocities)] = own[list(model.velocities)]
                engine.resetBaseVelocity(body, self._velocity[row, :3].tolist(), (0, 0, 0), self._id)
            self._agents[row], self._headings[row] = body, heading
            if entity.shape:
                self._row_of[body] = row
            self._heights[row], self._planar[row] = position[2], planar
            self._inertia[row, -1] = inertia / self.step_time if turns else 0.0

    def _add_vehicles(self, group: AgentGroup, number: int) -> None:
        vehicle = group.model.vehicle()
        assert vehicle is not None
        bodies, start, file = [], self.roster.start(group.name), str(vehicle.description())
        flags = vehicle.flags | self._loading
        for row, own in enumerate(self._states[number]):
            position, orientation = vehicle.pose(own)
            with quiet() as said:
                body = engine.loadURDF(file, position, orientation, flags=flags, physicsClientId=self._id)
            if body < 0:
                raise WorldError(f"PyBullet cannot load {file}: {last(said)}", "agents", group.name, "model")
            self._index[body] = start + row
            bodies.append(body)
            if not self._loading:
                vehicle.dress(engine, self._id, body)
        for body in bodies:
            self._solids.meet(body, collision.FREE)
        vehicle.attach(engine, self._id, bodies, self._states[number], self.step_time)
        self._vehicles.append((vehicle, number))

    def _add_obstacle(self, index: int, name: str, obstacle: Obstacle) -> None:
        pose = obstacle.pose()
        position = list(pose.position)
        if len(position) == 2:
            position.append(self._solids.standing(obstacle.shape))
        where = ("environment", "entities", name)
        kind = collision.FREE if obstacle.is_free else collision.LED if obstacle.path else collision.FIXED
        if obstacle.shape.wall:
            self._walls[name] = position[2]
            for body in self._solids.make_wall(obstacle.shape.wall, position, pose.heading):
                self._finish(body, index, obstacle, kind)
            return
        mass = obstacle.mass if obstacle.is_free else _IMMOVABLE if obstacle.path else 0.0
        assert mass is not None
        body = self._solids.make(mass, obstacle.shape, position, pose.heading, *where)
        self._entities[name] = body
        self._finish(body, index, obstacle, kind)
        if obstacle.is_free:
            velocity = [*(obstacle.velocity or ()), 0.0, 0.0, 0.0][:3]
            engine.resetBaseVelocity(body, velocity, (0.0, 0.0, obstacle.turn_rate), self._id)

    def _prepare(self) -> None:
        super()._prepare()
        self._entities: dict[str, int] = {}
        #: How high the middles of walls are [m].
        self._walls: dict[str, float] = {}

    def _finish(
        self, body: int, index: int, surface: Entity | Obstacle | Ground, kind: int, damping: float | None = None
    ) -> None:
        """Say what a body is: whose, of which surface, and whom it meets."""
        self._index[body] = index
        lost = self.parameters.damping if damping is None else damping
        self._solids.finish(body, surface.friction, surface.elasticity, lost)
        self._solids.meet(body, kind)
        base = self._postures.base(body)
        if base:
            self._frames[body] = base

    # -- steps

    def close(self) -> None:
        """Close the engine's client."""
        client = self.__dict__.get("_client")
        if client is not None:
            client.close()

    def _lay_out(self) -> None:
        super()._lay_out()
        if self._drifts:
            # Who moves in a plane is brought back to its height within the time step.
            step = seconds(self.time_step)
            self._plan[:, self._planar, 2] = (self._heights - self._positions[:, 2])[self._planar] / step
        for vehicle, number in self._vehicles:
            vehicle.actuate(self._applied[number])

    def _refresh(self) -> None:
        self._velocity = self._velocity.copy()
        for row in self._touched:
            velocity, spin = engine.getBaseVelocity(self._agents[row], self._id)
            self._velocity[row] = (*velocity, spin[2])

    def _push(self, forces: Array | None) -> None:
        """Give each body the velocity that the force would within this physics step, before contacts are solved."""
        for vehicle, _ in self._vehicles:
            vehicle.push()
        rows: Sequence[int] = range(len(self._agents))
        if not self._falls:
            rows = [] if forces is None else np.flatnonzero(forces.any(axis=1)).tolist()
        if not rows:
            return
        velocities = (self._velocity - self._fall).tolist()
        for row in rows:
            *velocity, turn_rate = velocities[row]
            engine.resetBaseVelocity(self._agents[row], velocity, (0.0, 0.0, turn_rate), self._id)

    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        rows, client, step, update = self._row_of, self._id, engine.stepSimulation, self._collisions.update
        while True:
            for name in self._moving:
                self._lead(name, number)
            step(client)
            number += 1
            met = update()
            if (met and rows) or number == last:
                self._touched = sorted({rows[body] for bodies in met for body in bodies if body in rows})
                if self._touched or number == last:
                    return number, bool(self._touched)

    def _lead(self, name: str, number: int) -> None:
        """Put an entity with a path where it is, with the velocity that brings it where the path is next."""
        body, path = self._entities[name], self.obstacles[name].path
        assert path is not None
        start, heading = seconds(self._time), self.obstacles[name].heading
        now, then = (path.pose(start + (number + ahead) * self.step_time, heading) for ahead in (0, 1))
        height = [self._solids.standing(self.obstacles[name].shape)] if len(now.position) == 2 else []
        position = [*now.position, *height]
        change = [after - before for after, before in zip([*then.position, *height], position, strict=True)]
        velocity = [by / self.step_time - fall for by, fall in zip(change, self._fall, strict=False)]
        engine.resetBasePositionAndOrientation(body, position, turn(now.heading), self._id)
        spin = (0.0, 0.0, (then.heading - now.heading) / self.step_time)
        engine.resetBaseVelocity(body, velocity, spin, self._id)

    def _find_overlaps(self) -> None:
        self._collisions.start()

    # -- what is read back

    def _bodies(self) -> tuple[Bodies, Bodies]:
        driven = self._look(self._agents, self._headings)
        free = self._look([self._entities[name] for name in self._free], self._free_headings)
        self._positions, self._headings = driven.positions, driven.headings
        self._free_headings = free.headings
        return driven, free

    def _look(self, bodies: Sequence[int], headings: Array) -> Bodies:
        """Read bodies; their headings count turns from where they were before."""
        if not bodies:
            return _NOBODY
        values = read_bodies(engine, self._id, bodies)
        if self._frames:
            for row, body in enumerate(bodies):
                if body in self._frames:
                    position, orientation = values[row, :3].tolist(), values[row, 3:7].tolist()
                    values[row, :7] = np.concatenate(
                        engine.multiplyTransforms(position, orientation, *self._frames[body])
                    )
        headings = continued(headings, yaws(values[:, 3:7]))
        return Bodies(values[:, :3], headings, values[:, [7, 8, 9, 12]])

    def _placement(self) -> Mapping[str, Array]:
        """Where the centres of mass of bodies are that move, how they are turned, and how their joints stand."""
        poses = read_bodies(engine, self._id, self._mobile)[:, :7]
        names = [name for name in self._articulations if self._articulations[name].joints]
        joints = {f"joints/{name}": self.joint_positions(name) for name in names}
        return {"bodies": poses, **{name: values for name, values in joints.items() if values is not None}}

    def _place(self, placement: Mapping[str, Array]) -> None:
        for body, pose in zip(self._mobile, placement["bodies"].tolist(), strict=True):
            engine.resetBasePositionAndOrientation(body, pose[:3], pose[3:], self._id)
        for name, described in self._articulations.items():
            if described.joints:
                self._postures.put(self._bodies_of(name), described, placement[f"joints/{name}"])
        for name in self._moving:
            self._lead(name, 0)

    @property
    def _mobile(self) -> Sequence[int]:
        """The bodies of agents in the order of the roster, and of free entities."""
        agents = [self._body_of[index] for index in range(len(self.roster))]
        return [*agents, *(self._entities[name] for name in self._free)]

    def _read_others(self, velocities: Array) -> None:
        for vehicle, number in self._vehicles:
            state, velocity = vehicle.read()
            state.flags.writeable = False
            self._states[number] = state
            group = self.groups[number]
            start, dimensions = self.roster.start(group.name), len(group.model.position)
            velocities[start : start + len(group), :dimensions] = velocity[:, :dimensions]

    def articulations(self) -> Mapping[str, Articulation]:
        """What bodies consist of; agents whose shape or model names no file look like their shape."""
        return self._articulations

    def body_poses(self, name: str) -> Array | None:
        """Where vehicles and free entities are, and how they are turned; what is driven stays upright."""
        if name not in self._free_rows:
            vehicles = {self.groups[number].name for _, number in self._vehicles}
            if name not in vehicles:
                return None
            if attitude_columns([element for element, _ in self.groups[self._number[name]].model.state]):
                return None
        return self._postures.poses(self._bodies_of(name))

    def joint_positions(self, name: str) -> Array | None:
        """How the joints of what a file describes stand."""
        described = self._articulations.get(name)
        return self._postures.joints(self._bodies_of(name), described) if described and described.joints else None

    def _bodies_of(self, name: str) -> Sequence[int]:
        """The engine's bodies of a group, or of an entity that has one."""
        if name in self._entities:
            return [self._entities[name]]
        start = self.roster.start(name)
        return [self._body_of[start + row] for row in range(len(self.groups[self._number[name]]))]

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure level rays against the shapes of the engine, from as high as the bodies are that send them."""
        count, width = directions.shape[:2]
        starts, towards = np.zeros((count, width, 3)), np.zeros((count, width, 3))
        starts[..., :2], towards[..., :2] = origins[:, None, :2], directions
        starts[..., 2] = self.body_positions([self.roster.ids[sender] for sender in senders.tolist()])[:, 2:] + height
        rays = np.repeat(senders, width), starts.reshape(-1, 3), towards.reshape(-1, 3)
        return sight.cast(self._id, self._index, *rays, reach).reshape(count, width)

    def body_positions(self, names: Sequence[str]) -> Array:
        """Return where bodies are in space; of walls, which are made of several, where the entity is."""
        places = super().body_positions(names)
        for row, name in enumerate(names):
            body = self._entities.get(name)
            if name in self.roster:
                body = self._body_of[self.roster.index(name)]
            elif name in self._walls:
                places[row, 2] = self._walls[name]
            if body is not None:
                places[row, 2] = self._postures.pose(body)[0][2]
        return places

    def camera_image(
        self, position: Sequence[float], target: Sequence[float], size: tuple[int, int], field_of_view: float
    ) -> Image:
        """Look at a point from another, by PyBullet's renderer on the processor."""
        if not self._painted:
            self._painted = True
            sight.paint(self._id, self._index, len(self.roster))
        return sight.look(self._id, self._index, position, target, size, field_of_view)
