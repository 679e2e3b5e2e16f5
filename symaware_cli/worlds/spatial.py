"""The spatial world: rigid bodies in space, moved by PyBullet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from symaware_cli.assets import asset
from symaware_cli.assets.asset import AssetFolders
from symaware_cli.core import (
    Entity,
    EntityGroup,
    ErrorCollector,
    Image,
    Obstacle,
    ScenarioView,
    Scenery,
    WorldError,
    seconds,
)
from symaware_cli.engine import appearances
from symaware_cli.geometry import Array, Articulation, Indices, Mask, attitude_columns
from symaware_cli.worlds import bullet_collisions, bullet_sensing
from symaware_cli.worlds.body_builder import BodyBuilder, BodyPart, collision_kind, turn
from symaware_cli.worlds.body_poses import BodyPoses, read_bodies
from symaware_cli.worlds.bullet import MOST_SHOWN, Client, engine
from symaware_cli.worlds.bullet_collisions import Collisions
from symaware_cli.worlds.bullet_vehicles import MARGIN, BulletVehicleBodies, joint_names
from symaware_cli.worlds.contact_tracker import GROUND
from symaware_cli.worlds.engine_files import EngineFiles
from symaware_cli.worlds.ground import GroundPlane
from symaware_cli.worlds.hull_check import warn_of_hulls
from symaware_cli.worlds.physics import BodyStates, OpaqueEngine, PhysicsEnvironment
from symaware_cli.worlds.vehicles import VehicleEnvironment

_Component = Annotated[float, Field(ge=-1e9, le=1e9)]

#: [kg] and [kg m^2]: the mass and inertia of bodies that nothing moves or tilts; larger ones upset the engine.
_IMMOVABLE = 1e9

#: [rad] The greatest angle by which the engine turns a body in a physics step (`ANGULAR_MOTION_THRESHOLD`).
_TURN = 0.25 * np.pi

#: [m] How far below its pose the body of an absent agent is kept.
_BURIED = 1e4


class PyBulletEnvironment(OpaqueEngine, VehicleEnvironment):
    """Rigid bodies in space that fall, push, rub and bounce off each other, by PyBullet.

    The z axis points upwards. Agents of models that move in a plane stand upright at one height, and the ground does
    not touch them.
    """

    dimensions = 3
    provides = ("forces", "images", "tilt", "vehicles")

    class Parameters(PhysicsEnvironment.Parameters):
        """Parameters of the spatial world."""

        gravity: tuple[_Component, _Component, _Component] = Field(
            (0.0, 0.0, -9.81),
            description="Acceleration of free bodies and of vehicles [x, y, z] [m/s^2]; other agents follow their "
            "models instead.",
        )
        ground: GroundPlane | None = Field(GroundPlane(), description="Ground plane; none if null.")
        height: float = Field(1.0, gt=0, description="Height of shapes that define none, such as walls [m].")
        recovery: float = Field(
            0.02,
            ge=0,
            le=1,
            description="Part of an overlap that a physics step undoes. To the speed at which vehicles and URDF files "
            "bounce it adds as large a part.",
        )
        iterations: int = Field(
            50, ge=1, le=1000, description="Number of iterations over all contacts in a physics step."
        )
        visuals: bool = Field(
            False,
            description="Whether URDF files are loaded with their visual shapes, for pictures; a racecar takes "
            "3 MB for that, and else a twentieth.",
        )
        gui: bool = Field(False, description="Whether to show the window of PyBullet; it needs a screen.")

    @property
    def gravity(self) -> Sequence[float]:
        """The gravity of the parameters."""
        given: Sequence[float] = self.parameters.gravity
        return given

    def _build(self) -> None:
        """Create bodies in a fixed order: the ground, agents, and entities by name."""
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
        self._greatest_turn_rate = _TURN / self.step_time
        self._gravity_step = np.array([*parameters.gravity, 0.0]) * self.step_time
        self._has_gravity = bool(self._gravity_step.any())
        self._pushes = self._has_gravity or any(actuator is None for actuator in self._actuators)
        pictures = parameters.gui or parameters.visuals
        self._loading = 0 if pictures else engine.URDF_IGNORE_VISUAL_SHAPES
        self._index: dict[int, int] = {}
        self.ground = parameters.ground.height if parameters.ground else None
        self._body_poses = BodyPoses(client)
        self._agents = [-1] * len(self._driven)
        #: The collision kind of each agent's body, and the initial poses of absent agents.
        self._collision_kinds = [bullet_collisions.ABSENT] * len(self._driven)
        self._absent_poses: dict[int, tuple[Sequence[float], Sequence[float]]] = {}
        #: The rows of the agents that contacts can divert, by body.
        self._row_of: dict[int, int] = {}
        self._headings = np.zeros(len(self._driven))
        self._heights = np.zeros(len(self._driven))
        self._planar = np.zeros(len(self._driven), bool)
        parts = {number: part for _, number, part in self._parts}
        folders = AssetFolders(self.folder, self.further_folders)
        errors = ErrorCollector()
        with EngineFiles() as files:
            self._builder = BodyBuilder(client, folders, files, parameters.height, self.ground, self._loading)
            if parameters.ground:
                self._add_ground(parameters.ground)
            for number, group in enumerate(self.groups):
                with errors.catch():
                    if number in parts:
                        self._add_driven(group, self._states[number], parts[number])
                    else:
                        self._add_vehicles(group, number)
            first = len(self.roster)
            for index, (name, obstacle) in enumerate(self.obstacles.items()):
                with errors.catch():
                    self._add_obstacle(first + index, name, obstacle)
            errors.raise_first()
        vehicles = {self.groups[number].name: vehicle.description() for vehicle, number in self._vehicles}
        self._articulations = appearances(self.groups, self.obstacles, vehicles, folders, parameters.height)
        self._drifts = bool(self._planar.any())
        self._free_headings = np.array([self.obstacles[name].heading for name in self._free])
        self._free_members = [self._entities[name] for name in self._free]
        self._body_of = {index: body for body, index in self._index.items()}
        ground = len(self.roster) + len(self.obstacles)
        self._collisions = Collisions(client, self._index, self._tracker, ground, self.step_time)
        self._coloured = False
        owned: dict[int, list[int]] = {}
        for body, index in self._index.items():
            owned.setdefault(index, []).append(body)
        spans = [
            self._builder.span(owned[first + number], self._levels[name]) for number, name in enumerate(self.obstacles)
        ]
        self._scenery = Scenery(self.obstacles, 0, dict(zip(self.obstacles, spans, strict=True)))

    # -- bodies

    def _add_ground(self, ground: GroundPlane) -> None:
        """Create the plane, and the slab if bodies stand on it."""
        named: dict[str, tuple[str, ...]] = {group.name: ("agents",) for group in self.groups}
        named |= dict.fromkeys(self.obstacles, ("environment", "entities"))
        if GROUND in named:
            raise WorldError(f"`{GROUND}` names the ground in contacts; give this another name", *named[GROUND], GROUND)
        index = len(self.roster) + len(self.obstacles)
        self._register(self._builder.make_plane(ground.height), index, ground, bullet_collisions.GROUND)
        free = [self.obstacles[name] for name in self._free]
        # Joints on a fixed base may move links to the ground, too.
        free += [each for each in self.obstacles.values() if each.shape.urdf and not each.is_free and not each.path]
        starts = [each.pose().position for each in free if collision_kind(each.shape) == bullet_collisions.FACED]
        for actuator, number, _ in self._parts:
            # Agents that move in a plane do not touch the ground.
            if (
                len(actuator.group.model.position) == 3
                and collision_kind(actuator.group.entity.shape) == bullet_collisions.FACED
            ):
                starts += self._states[number][:, list(actuator.group.model.position)].tolist()
        if starts:
            self._register(self._builder.make_slab(ground.height, starts), index, ground, bullet_collisions.SLAB)

    def _add_driven(self, group: EntityGroup, state: Array, part: slice) -> None:
        model, entity = group.model, group.entity
        turns, planar = model.heading is not None, len(model.position) == 2
        where = ("agents", group.name, "entity")
        for row, own in zip(range(part.start, part.stop), state, strict=True):
            position = own[list(model.position)].tolist()
            heading = float(own[model.heading]) if model.heading is not None else 0.0
            # The actuator sets the base's velocity, which links on moving joints would not feel: hold the joints.
            body = self._builder.make(entity.mass, entity.shape, position, turn(heading), *where, held=True)
            inertia = self._builder.moment(body, entity)
            turning = inertia if turns else _IMMOVABLE
            # Agents stay upright: nothing tilts them.
            upright = [_IMMOVABLE, _IMMOVABLE, turning]
            engine.changeDynamics(body, -1, mass=entity.mass, localInertiaDiagonal=upright, physicsClientId=self._id)
            kind = bullet_collisions.UPRIGHT if planar else collision_kind(entity.shape)
            self._register(body, int(self._driven[row]), entity, kind, damping=0.0)
            if model.velocities:
                self._velocity[row, : len(model.velocities)] = own[list(model.velocities)]
                engine.resetBaseVelocity(body, self._velocity[row, :3].tolist(), (0, 0, 0), self._id)
            self._agents[row], self._headings[row], self._collision_kinds[row] = body, heading, kind
            if entity.shape:
                self._row_of[body] = row
            self._heights[row], self._planar[row] = self._body_poses.pose(body)[0][2], planar
            self._inertia[row, -1] = inertia / self.step_time if turns else 0.0

    def _appear(self, row: int, velocity: Sequence[float]) -> None:
        body = self._agents[row]
        engine.resetBasePositionAndOrientation(body, *self._absent_poses.pop(row), self._id)
        engine.resetBaseVelocity(body, velocity, (0, 0, 0), self._id)
        self._builder.set_collision_kind(body, self._collision_kinds[row])

    def _vanish(self, row: int) -> None:
        body = self._agents[row]
        position, orientation = engine.getBasePositionAndOrientation(body, self._id)
        self._absent_poses[row] = position, orientation
        self._builder.set_collision_kind(body, bullet_collisions.ABSENT)
        # Cameras see all bodies that are near, whatever they collide with.
        buried = position[0], position[1], position[2] - _BURIED
        engine.resetBasePositionAndOrientation(body, buried, orientation, self._id)
        engine.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0), self._id)
        self._velocity[row] = 0.0

    def _add_vehicles(self, group: EntityGroup, number: int) -> None:
        if group.present is not None:
            raise WorldError("vehicles cannot enter or leave this world", "agents", group.name, "present")
        vehicle = self._vehicle(group)
        bodies, start, name = [], self.roster.start(group.name), vehicle.description().name
        file = self._builder.robot_file(asset.installed(vehicle.description(), "agents", group.name, "model"))
        flags = engine.URDF_USE_INERTIA_FROM_FILE if vehicle.inertia_from_file else 0
        for row, own in enumerate(self._states[number]):
            pose = vehicle.pose(own, MARGIN)
            body = self._builder.load_robot(file, name, *pose, flags, "agents", group.name, "model")
            self._index[body] = start + row
            bodies.append(body)
            if not self._loading:
                self._paint(body, vehicle.colours)
        for body in bodies:
            self._builder.set_collision_kind(body, bullet_collisions.FREE)
        self._attach(vehicle, number, BulletVehicleBodies(self._id, bodies))

    def _paint(self, body: int, colours: Mapping[str, tuple[float, float, float, float]]) -> None:
        """Replace the textures of links by colours: those of a wheel of the racecar take 0.9 MB."""
        for joint, name in enumerate(joint_names(self._id, body) if colours else ()):
            if name in colours:
                engine.changeVisualShape(
                    body, joint, textureUniqueId=-1, rgbaColor=colours[name], physicsClientId=self._id
                )

    def _add_obstacle(self, index: int, name: str, obstacle: Obstacle) -> None:
        pose = obstacle.pose()
        where = ("environment", "entities", name)
        kind = (
            collision_kind(obstacle.shape)
            if obstacle.is_free
            else bullet_collisions.ON_PATH
            if obstacle.path
            else bullet_collisions.FIXED
        )
        mass = obstacle.mass if obstacle.is_free else _IMMOVABLE if obstacle.path else 0.0
        assert mass is not None
        if obstacle.shape.wall:
            members = self._builder.make_wall(mass, obstacle.shape.wall, pose.position, pose.heading)
        else:
            held = obstacle.path is not None
            orientation = turn(pose.heading, obstacle.roll, obstacle.pitch)
            body = self._builder.make(mass, obstacle.shape, pose.position, orientation, *where, held=held)
            members = [BodyPart(body)]
            self._entities[name] = body
        for member in members:
            self._register(member.body, index, obstacle, kind)
        self._members[name] = members
        self._levels[name] = self._body_poses.pose(members[0].body)[0][2]
        if obstacle.is_free:
            velocity = [*(obstacle.velocity or ()), 0.0, 0.0, 0.0][:3]
            engine.resetBaseVelocity(members[0].body, velocity, (0.0, 0.0, obstacle.turn_rate), self._id)

    def _prepare(self) -> None:
        super()._prepare()
        #: The body of each entity that has one; all but walls.
        self._entities: dict[str, int] = {}
        self._members: dict[str, Sequence[BodyPart]] = {}
        #: The initial heights of entities [m].
        self._levels: dict[str, float] = {}

    def _register(
        self, body: int, index: int, surface: Entity | Obstacle | GroundPlane, kind: int, damping: float | None = None
    ) -> None:
        """Register a body with its owner, surface and collision kind."""
        self._index[body] = index
        lost = self.parameters.damping if damping is None else damping
        self._builder.set_surface(body, surface.friction, surface.elasticity, lost)
        self._builder.set_collision_kind(body, kind)
        self._body_poses.base(body)

    # -- steps

    def close(self) -> None:
        """Close the engine's client."""
        client = self.__dict__.get("_client")
        if client is not None:
            client.close()

    def _plan_velocities(self) -> None:
        super()._plan_velocities()
        if self._drifts:
            # Agents that move in a plane are brought back to their height within the time step.
            step = seconds(self.time_step)
            self._plan[:, self._planar, 2] = (self._heights - self._positions[:, 2])[self._planar] / step

    def _refresh(self) -> None:
        self._velocity = self._velocity.copy()
        for row in self._touched:
            velocity, spin = engine.getBaseVelocity(self._agents[row], self._id)
            self._velocity[row] = (*velocity, spin[2])

    def _push(self, forces: Array | None) -> None:
        """Set the velocities that the forces would cause in this physics step, before contacts are solved."""
        self._push_vehicles()
        rows: Sequence[int] = range(len(self._agents))
        if not self._has_gravity:
            rows = [] if forces is None else np.flatnonzero(forces.any(axis=1)).tolist()
        if not rows:
            return
        velocities = (self._velocity - self._gravity_step).tolist()
        for row in rows:
            *velocity, turn_rate = velocities[row]
            engine.resetBaseVelocity(self._agents[row], velocity, (0.0, 0.0, turn_rate), self._id)

    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        rows, client, step, update = self._row_of, self._id, engine.stepSimulation, self._collisions.update
        while True:
            for name in self._moving:
                self._move_along_path(name, number)
            step(client)
            number += 1
            met = update()
            if (met and rows) or number == last:
                self._touched = sorted({rows[body] for bodies in met for body in bodies if body in rows})
                if self._touched or number == last:
                    return number, bool(self._touched)

    def _move_along_path(self, name: str, number: int) -> None:
        """Set the pose of an entity with a path, and the velocity that brings it to the next pose of the path."""
        bodies, level, obstacle = self._members[name], self._levels[name], self.obstacles[name]
        tilt, course = (obstacle.roll, obstacle.pitch), self._course(name, number)
        self._body_poses.follow(bodies, level, course, tilt, self._gravity_step.tolist())

    def _find_overlaps(self) -> None:
        self._collisions.start()

    # -- states read from bodies

    def _read_driven(self) -> BodyStates:
        driven = BodyStates(*self._body_poses.read(self._agents, self._headings))
        self._positions, self._headings = driven.positions, driven.headings
        return driven

    def _read_free(self) -> BodyStates:
        """Headings stay within half a turn of the initial ones: turns are not counted."""
        return BodyStates(*self._body_poses.read(self._free_members, self._free_headings))

    def _displace(self, row: int, moved: Array, turned: float, faster: Array) -> None:
        self._headings[row] += turned
        self._body_poses.displace(self._agents[row], moved.tolist(), float(self._headings[row]), faster.tolist())

    def _placement(self) -> Mapping[str, Array]:
        """Return the poses of the centres of mass of moving bodies, and the positions of their joints."""
        poses = read_bodies(self._id, self._mobile)[:, :7]
        names = [name for name in self._articulations if self._articulations[name].joints]
        joints = {f"joints/{name}": self.joint_positions(name) for name in names}
        return {"bodies": poses, **{name: values for name, values in joints.items() if values is not None}}

    def _place(self, placement: Mapping[str, Array]) -> None:
        for body, pose in zip(self._mobile, placement["bodies"].tolist(), strict=True):
            engine.resetBasePositionAndOrientation(body, pose[:3], pose[3:], self._id)
        for name, described in self._articulations.items():
            if described.joints:
                self._body_poses.set_joints(self._bodies_of(name), described, placement[f"joints/{name}"])
        for name in self._moving:
            self._move_along_path(name, 0)

    @property
    def _mobile(self) -> Sequence[int]:
        """The bodies of agents in the order of the roster, and of free entities."""
        agents = [self._body_of[index] for index in range(len(self.roster))]
        return [*agents, *(self._entities[name] for name in self._free)]

    def find_warnings(self, view: ScenarioView) -> None:
        """Warn of meshes that are not convex, and of missing visual shapes."""
        super().find_warnings(view)
        warn_of_hulls(view, AssetFolders(self.folder, self.further_folders))

    def articulations(self) -> Mapping[str, Articulation]:
        """Return links and visual shapes of bodies; agents without a file look like their shape."""
        return self._articulations

    def body_poses(self, name: str) -> Array | None:
        """Return the poses of vehicles and free entities; None for other agents, which stay upright."""
        if name not in self._free_rows:
            vehicles = {self.groups[number].name for _, number in self._vehicles}
            if name not in vehicles:
                return None
            if attitude_columns([element for element, _ in self.groups[self._number[name]].model.state]):
                return None
        return self._body_poses.poses(self._bodies_of(name))

    def joint_positions(self, name: str) -> Array | None:
        """Return the joint positions of bodies from URDF files."""
        described = self._articulations.get(name)
        return self._body_poses.joints(self._bodies_of(name), described) if described and described.joints else None

    def _bodies_of(self, name: str) -> Sequence[int]:
        """Return the engine's bodies of a group, or of an entity with one body."""
        if name in self._entities:
            return [self._entities[name]]
        start = self.roster.start(name)
        return [self._body_of[start + row] for row in range(len(self.groups[self._number[name]]))]

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure horizontal rays against the shapes of the engine, from the heights of the bodies that cast them."""
        count, width = directions.shape[:2]
        starts, towards = np.zeros((count, width, 3)), np.zeros((count, width, 3))
        starts[..., :2], towards[..., :2] = origins[:, None, :2], directions
        starts[..., 2] = self.body_positions([self.roster.ids[sender] for sender in senders.tolist()])[:, 2:] + height
        rays = np.repeat(senders, width), starts.reshape(-1, 3), towards.reshape(-1, 3)
        return bullet_sensing.cast_rays(self._id, self._index, *rays, reach).reshape(count, width)

    def in_sight(self, ones: Indices, others: Indices) -> Mask:
        """Test the lines between the centres of bodies against the shapes of the engine."""
        count = len(self.roster)
        middles, obstacles = self.body_positions(self.roster.ids), range(count, count + len(self.obstacles))
        # Both directions share a line.
        keys, line = np.unique(np.minimum(ones, others) * count + np.maximum(ones, others), return_inverse=True)
        starts, ends = (middles.take(each, 0) for each in np.divmod(keys, count))
        return bullet_sensing.is_clear(self._id, self._index, obstacles, starts, ends)[line]

    def body_positions(self, names: Sequence[str]) -> Array:
        """Return the positions of bodies in space; for walls, which consist of several bodies, that of the entity."""
        places = super().body_positions(names)
        for row, name in enumerate(names):
            body = self._entities.get(name)
            if name in self.roster:
                body = self._body_of[self.roster.index(name)]
            elif name in self._levels and len(self.pose(name).position) == 2:
                places[row, 2] = self._levels[name]
            if body is not None:
                places[row, 2] = self._body_poses.pose(body)[0][2]
        return places

    def camera_image(
        self, position: Sequence[float], target: Sequence[float], size: tuple[int, int], field_of_view: float
    ) -> Image:
        """Render an image from a position towards a target, by PyBullet's renderer on the CPU."""
        if not self._coloured:
            self._coloured = True
            bullet_sensing.colour(self._id, self._index, len(self.roster))
        return bullet_sensing.render(self._id, self._index, position, target, size, field_of_view)
