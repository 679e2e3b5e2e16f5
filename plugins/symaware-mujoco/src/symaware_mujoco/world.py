"""The world of MuJoCo: rigid bodies in space, whose state can be captured and restored exactly.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.assets import AssetFolders, Mechanism, Vehicle
from symaware_cli.core import EntityGroup, ErrorCollector, Image, ScenarioView, WorldError
from symaware_cli.engine import Actuator, appearances
from symaware_cli.geometry import Array, Articulation, Indices, Mask, attitude, attitude_columns, continued, yaws
from symaware_cli.worlds import GROUND, BodyStates, GroundPlane, VehicleEnvironment, body_colour, warn_of_hulls
from symaware_mujoco.bounce import warn_of_bounces
from symaware_mujoco.cameras import render
from symaware_mujoco.engine_warnings import EngineWarningError, raise_warnings
from symaware_mujoco.motors import Motors
from symaware_mujoco.scene import AGENTS, ENTITIES, FLOOR, HIDDEN, LOOKS, Scene, Surface
from symaware_mujoco.surfaces import Surfaces
from symaware_mujoco.vehicles import MujocoVehicleBodies, add_vehicle, read_vehicle

_Component = Annotated[float, Field(ge=-1e9, le=1e9)]

#: [m] Smaller overlaps at the start count as standing on each other.
_TINY = 1e-6

#: The parts of the engine's data that are the state of a run: positions, velocities, time, and the solver's warm start.
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION

_NONE: NDArray[np.int64] = np.empty(0, np.int64)

#: A sentinel greater than the number of any pair, at the end of the numbers of touching pairs, so that searches stay in
#: range.
_LAST: NDArray[np.int64] = np.array([np.iinfo(np.int64).max])

#: The groups of geometries that rays of a lidar meet, and those that hide agents from each other.
_SOLID, _OPAQUE = np.array([1, 1, 1, 0, 1, 0], np.uint8), np.array([1, 0, 0, 0, 0, 0], np.uint8)


class MujocoEnvironment(VehicleEnvironment):
    """Rigid bodies in space that fall, push, rub and bounce off each other, by MuJoCo.

    The z axis points upwards. Agents stay upright; agents that move in a plane keep their height, and have no contact
    with the ground. Contacts are springs with dampers: while bodies push each other, they overlap by about their speed
    times four physics steps.
    """

    dimensions = 3
    provides = ("forces", "images", "mechanisms", "tilt", "vehicles")
    #: Attributes that follow from the scenario, and the engine's objects, whose state `captured` returns.
    uncaptured: ClassVar[Collection[str]] = (
        *("_model", "_data", "_owners", "_surfaces", "_bits", "_geometries", "_count"),
        *("_seen", "_keys", "_apart", "_any_apart"),
        *("_positions_at", "_velocities_at", "_free_positions_at", "_free_velocities_at", "_path_at", "_heights"),
        *("_articulations", "_bodies", "_dressed", "_groups", "_unseen", "_colours", "_hit"),
        "_levels",
        "_machines",
    )

    class Parameters(VehicleEnvironment.Parameters):
        """Parameters of the world."""

        substeps: int = Field(20, ge=1, le=1000, description="Number of physics steps in a time step.")
        gravity: tuple[_Component, _Component, _Component] = Field(
            (0.0, 0.0, -9.81),
            description="Acceleration of free bodies [x, y, z] [m/s^2]; agents follow their models instead.",
        )
        ground: GroundPlane | None = Field(GroundPlane(), description="Ground plane; none if null.")
        height: float = Field(1.0, gt=0, description="Height of shapes that define none, such as walls [m].")
        visuals: bool = Field(
            False,
            description="Whether cameras see the visual shapes of bodies from URDF files; otherwise, collision shapes.",
        )
        iterations: int = Field(100, ge=1, le=1000, description="Greatest number of iterations of the contact solver.")

    @property
    def gravity(self) -> Sequence[float]:
        """The gravity of the parameters."""
        given: Sequence[float] = self.parameters.gravity
        return given

    # -- the model

    def _actuator(self, group: EntityGroup, seed: int) -> Actuator | None:
        return super()._actuator(group, seed) if group.model.mechanism() is None else None

    def _build(self) -> None:
        """Create bodies in a fixed order: the ground, agents, and entities by name."""
        parameters, count = self.parameters, len(self.roster)
        self.ground = parameters.ground.height if parameters.ground else None
        folders = AssetFolders(self.folder, self.further_folders)
        options = self.step_time, parameters.gravity, parameters.iterations, parameters.height, self.ground
        scene = Scene(*options, folders)
        ground = count + len(self.obstacles)
        if parameters.ground:
            if GROUND in self.obstacles or GROUND in self._number:
                where = ("environment", "entities") if GROUND in self.obstacles else ("agents",)
                raise WorldError(f"`{GROUND}` names the ground in contacts; give this another name", *where, GROUND)
            surface = Surface(ground, parameters.ground.friction, parameters.ground.elasticity)
            scene.add_ground(parameters.ground.height, surface)
        self._heights = np.zeros(len(self._driven))
        errors = ErrorCollector()
        parts = {number: part for _, number, part in self._parts}
        vehicles: dict[int, Vehicle] = {}
        mechanisms: dict[int, Mechanism] = {}
        for number, group in enumerate(self.groups):
            with errors.catch():
                if number in parts:
                    self._add_group(scene, group, parts[number])
                elif (mechanism := group.model.mechanism()) is not None:
                    self._add_robots(scene, group, number, mechanism)
                    mechanisms[number] = mechanism
                else:
                    vehicles[number] = self._add_vehicles(scene, group)
        for number, (name, obstacle) in enumerate(self.obstacles.items()):
            with errors.catch():
                scene.add_obstacle(name, obstacle, Surface(count + number, obstacle.friction, obstacle.elasticity))
        errors.raise_first()
        self._levels = scene.levels
        files = {self.groups[number].name: vehicle.portable_description() for number, vehicle in vehicles.items()}
        self._articulations = appearances(self.groups, self.obstacles, files, folders, parameters.height)
        robots = [*files, *(self.groups[number].name for number in mechanisms)]
        self._dressed = self._dress(scene, robots) if parameters.visuals else ()
        model = self._model = scene.compile()
        self._machines = [
            Motors(model, self.groups[number], number, mechanism, self.step_time)
            for number, mechanism in mechanisms.items()
        ]
        self._data = mujoco.MjData(model)
        self._index_bodies()
        self._index_surfaces(scene)
        #: The bodies of each group of vehicles, by its number.
        self._bodies = {
            number: MujocoVehicleBodies(model, self._data, self.groups[number], self._surfaces.frictions)
            for number in vehicles
        }
        for number, vehicle in vehicles.items():
            for row, own in enumerate(self._states[number]):
                self._bodies[number].put(row, *vehicle.pose(own))
        self._place_all()
        self._attach_all(vehicles, errors)

    def find_warnings(self, view: ScenarioView) -> None:
        """Warn of meshes that are not convex, missing visual shapes, and elasticities that are inexact."""
        super().find_warnings(view)
        warn_of_hulls(view, AssetFolders(self.folder, self.further_folders))
        warn_of_bounces(view, self.parameters.ground)

    def _add_group(self, scene: Scene, group: EntityGroup, part: slice) -> None:
        entity, turns = group.entity, group.model.heading is not None
        planar = len(group.model.position) == 2
        height = scene.level(entity.shape, "agents", group.name, "entity") if planar else None
        for row in range(part.start, part.stop):
            index = int(self._driven[row])
            self._heights[row] = height or 0.0
            surface = Surface(index, entity.friction, entity.elasticity)
            scene.add_agent(self.roster.ids[index], entity, height, turns, surface, "agents", group.name, "entity")

    def _add_robots(self, scene: Scene, group: EntityGroup, number: int, mechanism: Mechanism) -> None:
        where, shape = ("agents", group.name), group.entity.shape
        if group.present is not None:
            raise WorldError("robots with motors cannot enter or leave this world", *where, "present")
        if mechanism.stands and self.ground is None:
            said = f"the robots of `{group.name}` drive on the ground, and there is none"
            raise WorldError(said, "environment", "with", "ground")
        assert shape is not None
        start = self.roster.start(group.name)
        for row, (id, state) in enumerate(zip(group.ids, self._states[number], strict=True)):
            surface = Surface(start + row, group.entity.friction, group.entity.elasticity)
            posture = mechanism.posture(state)
            scene.levels[id] = scene.add_robot_agent(id, shape, posture, mechanism, surface, *where, "entity")

    def _add_vehicles(self, scene: Scene, group: EntityGroup) -> Vehicle:
        vehicle = self._vehicle(group)
        robot = read_vehicle(vehicle.portable_description(), "agents", group.name, "model")
        start = self.roster.start(group.name)
        for row, name in enumerate(group.ids):
            add_vehicle(scene, name, robot, Surface(start + row, group.entity.friction, group.entity.elasticity))
        return vehicle

    def _dress(self, scene: Scene, agents: Collection[str]) -> Sequence[int]:
        """Add the visual shapes of vehicles and robots, and return the indices of those with any."""
        bodies = {self.roster.index(id): (id, name) for name in agents for id in self.groups[self._number[name]].ids}
        first = len(self.roster)
        bodies |= {
            first + index: (name, name) for index, name in enumerate(self.obstacles) if self.obstacles[name].shape.robot
        }
        found: list[int] = []
        for index, (id, name) in bodies.items():
            described = self._articulations[name]
            if any(link.visuals for link in described.links):
                scene.dress(id, described, Surface(index, 0.0, 0.0))
                found.append(index)
        return found

    def _attach_all(self, vehicles: Mapping[int, Vehicle], errors: ErrorCollector) -> None:
        """Attach vehicles to their bodies."""
        for number, vehicle in vehicles.items():
            with errors.catch():
                self._attach(vehicle, number, self._bodies[number])
        errors.raise_first()
        self._surfaces.apply(self._model, self._bits[0])
        self._pushes = bool(vehicles)

    def _index_bodies(self) -> None:
        """Find the indices of the bodies' coordinates in those of the engine."""
        model = self._model
        columns = ("x", "y", "z", "heading")
        #: For each agent, the indices of x, y, z and heading in the engine's positions and velocities; -1 for none.
        self._positions_at = np.full((len(self._driven), 4), -1, np.intp)
        self._velocities_at = np.full((len(self._driven), 4), -1, np.intp)
        for row, index in enumerate(self._driven.tolist()):
            for column, letter in enumerate(columns):
                joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{self.roster.ids[index]}/{letter}")
                if joint >= 0:
                    self._positions_at[row, column] = model.jnt_qposadr[joint]
                    self._velocities_at[row, column] = model.jnt_dofadr[joint]

        def places(names: Sequence[str]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
            joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}/free") for name in names]
            positions = np.array([model.jnt_qposadr[joint] for joint in joints], np.intp).reshape(-1, 1) + np.arange(7)
            velocities = np.array([model.jnt_dofadr[joint] for joint in joints], np.intp).reshape(-1, 1) + np.arange(6)
            return positions, velocities

        self._free_positions_at, self._free_velocities_at = places(self._free)
        self._path_at = places(self._moving)

    def _index_surfaces(self, scene: Scene) -> None:
        model = self._model
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, number) for number in range(model.ngeom)]
        surfaces = [scene.surfaces[name] for name in names]
        self._owners = np.array([each.owner for each in surfaces], np.intp)
        #: The collision bits of each geometry while its agent is present.
        self._bits = model.geom_contype.copy(), model.geom_conaffinity.copy()
        agents, ground = len(self.roster), len(self.roster) + len(self.obstacles)
        looks = model.geom_group == LOOKS
        kinds = np.select([self._owners < agents, self._owners >= ground], [AGENTS, FLOOR], ENTITIES)
        model.geom_group[:] = self._groups = np.where(looks, LOOKS, kinds).astype(np.int32)
        #: Geometries that cameras do not see: collision shapes of bodies with visual shapes.
        self._unseen = np.flatnonzero(~looks & np.isin(self._owners, np.array(self._dressed, np.intp)))
        plain = [body_colour(index, agents) for index in self._owners.tolist()]
        self._colours = np.where(looks[:, None], model.geom_rgba[:, :3], np.array(plain).reshape(-1, 3))
        self._geometries = {index: np.flatnonzero(self._owners == index) for index in range(len(self.roster))}
        self._hit = np.zeros(1, np.int32)
        self._surfaces = Surfaces(surfaces, self.step_time)
        self._surfaces.apply(model, self._bits[0])

    def _place_all(self) -> None:
        model, data = self._model, self._data
        positions, headings = np.zeros((len(self._driven), 3)), np.zeros(len(self._driven))
        for actuator, number, part in self._parts:
            kind, state = actuator.group.model, self._states[number]
            positions[part, : len(kind.position)] = state[:, list(kind.position)]
            if kind.heading is not None:
                headings[part] = state[:, kind.heading]
            if kind.velocities:
                self._velocity[part, : len(kind.velocities)] = state[:, list(kind.velocities)]
        self._write(self._positions_at, data.qpos, np.column_stack([positions, headings]))
        self._write(self._velocities_at, data.qvel, self._velocity)
        for row, name in enumerate(self._free):
            obstacle = self.obstacles[name]
            velocity = [*(obstacle.velocity or ()), 0.0, 0.0, 0.0][:3]
            turned = _rotated(
                data.qpos[self._free_positions_at[row, 3:]], np.array([0.0, 0.0, obstacle.turn_rate]), -1.0
            )
            data.qvel[self._free_velocities_at[row]] = [*velocity, *turned]
        self._free_headings = np.array([self.obstacles[name].heading for name in self._free])
        self._follow_paths(0)
        for machine in self._machines:
            machine.place(data, self._states[machine.number])
        mujoco.mj_forward(model, data)
        for actuator, _, part in self._parts:
            if actuator.group.model.heading is not None:
                places = self._velocities_at[part, 3]
                self._inertia[part, 3] = model.dof_M0[places] / self.step_time
        #: The number of bodies, and the numbers of the touching pairs, ascending.
        self._count = len(self.roster) + len(self.obstacles) + 1
        self._touching = _LAST
        #: Results of the last step: the geometries of its contacts, the numbers of their pairs, and the contacts
        #: without touch.
        self._seen: bytes | None = None
        self._keys, self._apart, self._any_apart = _NONE, np.empty(0, bool), False

    @staticmethod
    def _write(places: NDArray[np.intp], into: Array, values: Array) -> None:
        known = places >= 0
        into[places[known]] = values[known]

    def close(self) -> None:
        """Release the engine's model."""
        for name in ("_bodies", "_data", "_model"):
            self.__dict__.pop(name, None)

    # -- agents that enter and leave

    def _appear(self, row: int, velocity: Sequence[float]) -> None:
        self._velocity[row, :3] = velocity
        self._write(self._velocities_at[row], self._data.qvel, self._velocity[row])
        self._show_present()

    def _vanish(self, row: int) -> None:
        self._velocity[row] = 0.0
        self._write(self._velocities_at[row], self._data.qvel, self._velocity[row])
        self._show_present()

    def _enter(self, group: EntityGroup, rows: Sequence[int]) -> None:
        number = self._number[group.name]
        if number not in self._bodies:
            super()._enter(group, rows)
            return
        vehicle, state = self._vehicle_of(number), self._states[number]
        for row in rows:
            self._bodies[number].put(row, *vehicle.pose(state[row]))
        vehicle.start(rows, state[list(rows)])
        self._show_present()

    def _leave(self, group: EntityGroup, rows: Sequence[int]) -> None:
        if self._number[group.name] not in self._bodies:
            super()._leave(group, rows)
            return
        self._show_present()

    def _read_others(self, velocities: Array) -> None:
        # The bodies of absent vehicles move freely in the engine.
        for vehicle, number in self._vehicles:
            present, state = self.groups[number].present, self._states[number]
            for row in [] if present is None else np.flatnonzero(~present).tolist():
                self._bodies[number].put(row, *vehicle.pose(state[row]))
        super()._read_others(velocities)
        for machine in self._machines:
            number = machine.number
            state, velocity = machine.states(self._data, self._states[number])
            state.flags.writeable = False
            self._states[number] = state
            start, dimensions = self.roster.starts[number], len(machine.group.model.position)
            velocities[start : start + len(state), :dimensions] = velocity[:, :dimensions]

    def _show_present(self) -> None:
        """Let the bodies of present agents, but not of absent ones, collide and stop rays."""
        model = self._model
        for index, geometries in self._geometries.items():
            there = self.present is None or bool(self.present[index])
            for bits, own in zip((model.geom_contype, model.geom_conaffinity), self._bits, strict=True):
                bits[geometries] = own[geometries] if there else 0
            model.geom_group[geometries] = self._groups[geometries] if there else HIDDEN

    # -- steps

    def _refresh(self) -> None:
        self._velocity = self._read_motion()

    def _read_motion(self) -> Array:
        found: Array = np.where(self._velocities_at >= 0, self._data.qvel[self._velocities_at], 0.0)
        return found

    def _push(self, forces: Array | None) -> None:
        """Set the velocities that the forces cause in this physics step, before contacts are solved."""
        self._push_vehicles()
        for bodies in self._bodies.values():
            bodies.turn_rotors()
        if forces is not None:
            self._write(self._velocities_at, self._data.qvel, self._velocity)

    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        retained = (1.0 - self.parameters.damping) ** self.step_time
        while True:
            self._follow_paths(number)
            if retained != 1.0 and len(self._free):
                self._data.qvel[self._free_velocities_at] *= retained
            self._step_engine()
            raise_warnings(self._data)
            number += 1
            met = self._track_contacts()
            if met or number == last:
                return number, met

    def _step_engine(self) -> None:
        model, data = self._model, self._data
        if self._surfaces.is_uniform and not self._machines:
            mujoco.mj_step(model, data)
            return
        mujoco.mj_step1(model, data)
        if data.ncon and not self._surfaces.is_uniform:
            self._surfaces.correct(model, data)
        for machine in self._machines:
            machine.apply(data)
        mujoco.mj_step2(model, data)

    def _plan_velocities(self) -> None:
        super()._plan_velocities()
        for machine in self._machines:
            machine.command(self._applied[machine.number])

    def _follow_paths(self, number: int) -> None:
        """Set the poses and velocities of entities with a path at the beginning of a physics step."""
        if not self._moving:
            return
        data = self._data
        for name, positions, velocities in zip(self._moving, *self._path_at, strict=True):
            course, obstacle = self._course(name, number), self.obstacles[name]
            x, y, z, w = attitude(obstacle.roll, obstacle.pitch, course.heading).tolist()
            place = data.qpos[positions]
            height = course.position[2] if len(course.position) == 3 else place[2]
            data.qpos[positions] = [*course.position[:2], height, w, x, y, z]
            turned = _rotated(data.qpos[positions[3:]], np.array([0.0, 0.0, course.turn_rate]), -1.0)
            data.qvel[velocities] = [*[*course.velocity, 0.0][:3], *turned]

    def _track_contacts(self) -> bool:
        """Report contacts that began or ended in the last physics step; return whether an agent touches something."""
        tracker = self._tracker
        if self._seen == b"" and not self._data.ncon:
            return tracker.agents > 0  # nothing was near before, and nothing is now
        contacts = self._data.contact
        # A pair touches from the first contact that the engine counts until the bodies are no longer near each other.
        # From one step to the next, mostly the same pairs are near.
        begun = ended = _NONE
        seen = contacts.geom.tobytes()
        if seen != self._seen:
            self._seen, self._keys = seen, self._pair_keys(contacts)
            ended = self._find_apart()
        keys = self._keys
        if self._any_apart:
            begun = np.unique(keys[self._apart & (contacts.exclude == 0)])
        if len(begun):
            distances, points = contacts.dist, contacts.pos
            for key in begun.tolist():
                number = _nearest(keys, distances, key)
                depth = max(0.0, -float(distances[number]))
                tracker.begin(self._pair_of(key), tuple(points[number].tolist()), depth)
        if tracker.fresh:
            self._add_impulses(keys, contacts)
        for key in ended.tolist():
            tracker.end(self._pair_of(key))
        if len(begun) or len(ended):
            # Ended contacts are no longer near, so their keys are absent.
            held = np.setdiff1d(self._touching, ended, assume_unique=True) if len(ended) else self._touching
            self._touching = np.sort(np.concatenate([held, begun]))
            self._find_apart()
        return tracker.agents > 0

    def _find_apart(self) -> NDArray[np.int64]:
        """Find the contacts of near pairs that do not touch; return the pairs that are no longer near."""
        touching, keys = self._touching, self._keys
        places = touching.searchsorted(keys)
        touch = touching[places] == keys
        self._apart, self._any_apart = ~touch, not touch.all()
        is_over = np.ones(len(touching), bool)
        is_over[places[touch]] = is_over[-1] = False
        return touching[is_over]

    def _add_impulses(self, keys: NDArray[np.int64], contacts: Any) -> None:
        """Add the normal forces of this physics step to the impulses of the contacts that began in this time step."""
        fresh = {one * self._count + other for one, other in self._tracker.fresh}
        addresses = contacts.efc_address
        numbers = [number for number, key in enumerate(keys.tolist()) if key in fresh and addresses[number] >= 0]
        if not numbers:
            return
        # With elliptic cones, the first force of a contact is the one along its normal.
        forces = self._data.efc_force[addresses[numbers]] * self.step_time
        for key, impulse in zip(keys[numbers].tolist(), forces.tolist(), strict=True):
            self._tracker.add_impulse(self._pair_of(key), impulse)

    def _pair_keys(self, contacts: Any) -> NDArray[np.int64]:
        """Return a number for the two bodies of each contact, which sorts as their indices do; shape (contacts,)."""
        one, other = self._owners[contacts.geom.T] if self._data.ncon else (_NONE, _NONE)
        keys: NDArray[np.int64] = np.minimum(one, other) * self._count + np.maximum(one, other)
        return keys

    def _pair_of(self, key: int) -> tuple[int, int]:
        return divmod(key, self._count)

    def _find_overlaps(self) -> None:
        self._show_present()
        mujoco.mj_forward(self._model, self._data)
        try:
            raise_warnings(self._data)
        except EngineWarningError as error:
            raise WorldError(str(error), "environment") from error
        contacts = self._data.contact
        keys, distances, points = self._pair_keys(contacts), contacts.dist, contacts.pos
        resting = []
        for key in np.unique(keys).tolist():
            number = _nearest(keys, distances, key)
            depth, point = -float(distances[number]), tuple(points[number].tolist())
            if depth > _TINY:
                self._tracker.start(self._pair_of(key), point, depth)
            elif not contacts.exclude[number]:
                self._tracker.begin_resting(self._pair_of(key), point)
                resting.append(key)
        self._touching, self._seen = np.concatenate([np.array(resting, np.int64), _LAST]), None

    # -- states read from bodies

    def _read_driven(self) -> BodyStates:
        if not len(self._driven):
            return BodyStates(np.empty((0, 3)), np.empty(0), np.empty((0, 4)))
        coordinates = np.where(self._positions_at >= 0, self._data.qpos[self._positions_at], 0.0)
        planar = self._positions_at[:, 2] < 0
        coordinates[planar, 2] = self._heights[planar]
        return BodyStates(coordinates[:, :3], coordinates[:, 3], self._read_motion())

    def _read_free(self) -> BodyStates:
        poses, motion = self._data.qpos[self._free_positions_at], self._data.qvel[self._free_velocities_at]
        orientations = poses[:, [4, 5, 6, 3]]  # (w, x, y, z) to (x, y, z, w)
        headings = continued(self._free_headings, yaws(orientations)) if len(poses) else np.empty(0)
        motion[:, 3] = _upright_rates(poses, motion[:, 3:])
        return BodyStates(poses[:, :3], headings, motion[:, :4], orientations)

    def _machine_of(self, name: str) -> Motors | None:
        return next((each for each in self._machines if each.group.name == name), None)

    def _push_others(self, number: int, rows: Sequence[int], change: Array) -> None:
        if number not in self._bodies:
            raise NotImplementedError("robots with motors cannot be displaced")
        super()._push_others(number, rows, change)

    def _displace(self, row: int, moved: Array, turned: float, faster: Array) -> None:
        data = self._data
        for places, into, change in (
            (self._positions_at[row], data.qpos, [*moved.tolist(), turned]),
            (self._velocities_at[row], data.qvel, [*faster.tolist(), 0.0]),
        ):
            known = places >= 0
            into[places[known]] += np.array(change)[known]

    def _placement(self) -> Mapping[str, Array]:
        return {"bodies": self._data.qpos.copy()}

    def _place(self, placement: Mapping[str, Array]) -> None:
        self._data.qpos[:] = placement["bodies"]
        mujoco.mj_forward(self._model, self._data)

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure horizontal rays against the bodies of the engine, from the heights of the senders."""
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        distances = np.full(directions.shape[:2], np.inf)
        count = directions.shape[1]
        geometries, found, normals = np.empty(count, np.int32), np.empty(count), np.empty((3 * count, 1))
        levels = self.body_positions([self.roster.ids[sender] for sender in senders.tolist()])[:, 2]
        for row, sender in enumerate(senders.tolist()):
            start = np.array([*origins[row, :2].tolist(), levels[row] + height])
            towards = np.zeros((count, 3))
            towards[:, :2] = directions[row]
            # A body may have several parts.
            own = self._geometries[sender]
            groups = model.geom_group[own]
            model.geom_group[own] = HIDDEN
            mujoco.mj_multiRay(
                model, data, start, towards.ravel(), _SOLID, True, -1, geometries, found, normals, count, reach
            )
            model.geom_group[own] = groups
            distances[row] = np.where(found < 0.0, np.inf, found)
        return distances

    def in_sight(self, ones: Indices, others: Indices) -> Mask:
        """Test the lines between the centres of bodies against the shapes of the engine."""
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        middles, free = self.body_positions(self.roster.ids), np.ones(len(ones), bool)
        for row, (one, other) in enumerate(zip(ones.tolist(), others.tolist(), strict=True)):
            # Both directions share one line.
            start, end = middles[min(one, other)], middles[max(one, other)]
            hit = mujoco.mj_ray(model, data, start, end - start, _OPAQUE, True, -1, self._hit, None)
            free[row] = not 0.0 <= hit <= 1.0
        return free

    def camera_image(
        self, position: Sequence[float], target: Sequence[float], size: tuple[int, int], field_of_view: float
    ) -> Image:
        """Make an image from a position towards a target, by rays; no screen and no graphics library is needed."""
        mujoco.mj_kinematics(self._model, self._data)
        ground = np.flatnonzero(self._groups == FLOOR)
        seen = self._owners, self._colours, self._unseen, ground
        return render(self._model, self._data, *seen, position, target, size, field_of_view)

    def body_positions(self, names: Sequence[str]) -> Array:
        """Return the positions of bodies in space."""
        places = super().body_positions(names)
        for row, name in enumerate(names):
            places[row, 2] = self._height_of(name)
        return places

    def _height_of(self, name: str) -> float:
        if name in self.roster:
            index = self.roster.index(name)
            for number, bodies in self._bodies.items():
                row = index - self.roster.starts[number]
                if 0 <= row < bodies.count:
                    return float(bodies.poses()[row, 2])
            if index not in self._driven:
                base = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}/base")
                return self._levels[name] if base < 0 else float(self._data.qpos[self._model.jnt_qposadr[base] + 2])
            row = int(np.flatnonzero(self._driven == self.roster.index(name))[0])
            place = self._positions_at[row, 2]
            return float(self._heights[row] if place < 0 else self._data.qpos[place])
        free = self._free_rows.get(name)
        return self._levels[name] if free is None else float(self._data.qpos[self._free_positions_at[free, 2]])

    def articulations(self) -> Mapping[str, Articulation]:
        """Return the links and visual shapes of bodies that turn in space."""
        return self._articulations

    def body_poses(self, name: str) -> Array | None:
        """Return the poses of vehicles, robots with a free base and free entities; None for upright bodies."""
        number = self._number.get(name, -1)
        machine = self._machine_of(name)
        if machine is not None or number in self._bodies:
            if attitude_columns([element for element, _ in self.groups[number].model.state]):
                return None
            return self._bodies[number].poses() if machine is None else machine.poses(self._data)
        row = self._free_rows.get(name)
        if row is None:
            return None
        pose = self._data.qpos[self._free_positions_at[row]]
        return np.concatenate([pose[:3], np.roll(pose[3:], -1)])[None]

    def joint_positions(self, name: str) -> Array | None:
        """Return the positions of the joints of vehicles and robots [rad] or [m]; shape (n, joints)."""
        described = self._articulations.get(name)
        if described is None or not described.joints:
            return None
        machine = self._machine_of(name)
        if machine is not None:
            return machine.joint_positions(self._model, self._data, list(described.joints))
        ids = self.groups[self._number[name]].ids if name in self._number else [name]
        joints = [
            [mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_JOINT, f"{id}/{each}") for each in described.joints]
            for id in ids
        ]
        found: Array = self._data.qpos[self._model.jnt_qposadr[np.array(joints)]]
        return found

    # -- the state of a run

    def captured(self) -> Any:
        """Return the engine's state; all else follows from attributes."""
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        return state

    def restored(self, state: Any) -> None:
        """Set the engine to a state."""
        self._seen = None
        mujoco.mj_setState(self._model, self._data, state, _STATE)
        self._show_present()
        mujoco.mj_forward(self._model, self._data)
        # The solver's warm start is part of the state, and was just replaced.
        mujoco.mj_setState(self._model, self._data, state, _STATE)


def _nearest(keys: NDArray[np.int64], distances: Array, key: int) -> int:
    """Return the first of the nearest contacts of two bodies."""
    numbers = np.flatnonzero(keys == key)
    return int(numbers[np.argmin(distances[numbers])])


def _upright_rates(poses: Array, spins: Array) -> Array:
    """Return turn rates about the vertical [rad/s], shape (n,), from those about the axes of the bodies.

    Args:
        poses: Positions and quaternions (w, x, y, z); shape (n, 7).
        spins: Turn rates about the axes of the bodies [rad/s]; shape (n, 3).
    """
    w, x, y, z = poses[:, 3:].T
    return np.asarray(
        2.0 * (x * z - w * y) * spins[:, 0]
        + 2.0 * (y * z + w * x) * spins[:, 1]
        + (1.0 - 2.0 * (x * x + y * y)) * spins[:, 2]
    )


def _rotated(quaternion: Array, vector: Array, direction: float) -> Array:
    """Rotate a vector by a quaternion (w, x, y, z), or back if the direction is -1."""
    turned, given = np.empty(3), np.array(quaternion, float)
    given[1:] *= direction
    mujoco.mju_rotVecQuat(turned, vector, given)
    return turned
