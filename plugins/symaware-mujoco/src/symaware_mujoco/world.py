"""The world of MuJoCo: rigid bodies in space, whose state can be captured and restored exactly.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import mujoco
import numpy as np
from pydantic import Field

from symaware_cli.assets import AssetFolders, Mechanism, Vehicle
from symaware_cli.core import EntityGroup, ErrorCollector, Image, ScenarioView, WorldError
from symaware_cli.engine import Actuator, appearances
from symaware_cli.geometry import Array, Articulation, Indices, Mask, attitude, attitude_columns
from symaware_cli.worlds import GROUND, BodyStates, GroundPlane, VehicleEnvironment, warn_of_hulls
from symaware_mujoco.bounce import warn_of_bounces
from symaware_mujoco.coordinates import FreeCoordinates, UprightCoordinates
from symaware_mujoco.engine_warnings import EngineWarningError, raise_warnings
from symaware_mujoco.geometries import Geometries
from symaware_mujoco.motors import Motors
from symaware_mujoco.scene import Scene, Surface
from symaware_mujoco.surfaces import Surfaces
from symaware_mujoco.touching_pairs import TouchingPairs
from symaware_mujoco.vehicles import MujocoVehicleBodies, add_vehicle, read_vehicle

_Component = Annotated[float, Field(ge=-1e9, le=1e9)]

#: The parts of the engine's data that are the state of a run: positions, velocities, time, and the solver's warm start.
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


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
        *("_model", "_data", "_surfaces", "_geometries", "_upright", "_free_coordinates", "_path_coordinates"),
        *("_articulations", "_bodies", "_levels", "_machines"),
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
        heights = np.zeros(len(self._driven))
        errors = ErrorCollector()
        parts = {number: part for _, number, part in self._parts}
        vehicles: dict[int, Vehicle] = {}
        mechanisms: dict[int, Mechanism] = {}
        for number, group in enumerate(self.groups):
            with errors.catch():
                if number in parts:
                    heights[parts[number]] = self._add_group(scene, group, parts[number])
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
        dressed = self._dress(scene, robots) if parameters.visuals else ()
        model = self._model = scene.compile()
        self._machines = [
            Motors(model, self.groups[number], number, mechanism, self.step_time)
            for number, mechanism in mechanisms.items()
        ]
        self._data = mujoco.MjData(model)
        self._upright = UprightCoordinates(model, [self.roster.ids[index] for index in self._driven.tolist()], heights)
        self._free_coordinates = FreeCoordinates(model, self._free)
        self._path_coordinates = FreeCoordinates(model, self._moving)
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, number) for number in range(model.ngeom)]
        surfaces = [scene.surfaces[name] for name in names]
        self._geometries = Geometries(model, surfaces, count, ground, dressed)
        self._surfaces = Surfaces(surfaces, self.step_time)
        self._surfaces.apply(model, self._geometries.types)
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

    def _add_group(self, scene: Scene, group: EntityGroup, part: slice) -> float:
        """Add agents that stay upright, and return their height if they move in a plane, else 0 [m]."""
        entity, turns = group.entity, group.model.heading is not None
        planar = len(group.model.position) == 2
        height = scene.level(entity.shape, "agents", group.name, "entity") if planar else None
        for row in range(part.start, part.stop):
            index = int(self._driven[row])
            surface = Surface(index, entity.friction, entity.elasticity)
            scene.add_agent(self.roster.ids[index], entity, height, turns, surface, "agents", group.name, "entity")
        return height or 0.0

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
        self._surfaces.apply(self._model, self._geometries.types)
        self._pushes = bool(vehicles)

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
        self._upright.set_positions(data, np.column_stack([positions, headings]))
        self._upright.set_velocities(data, self._velocity)
        for row, name in enumerate(self._free):
            obstacle = self.obstacles[name]
            velocity = [*(obstacle.velocity or ()), 0.0, 0.0, 0.0][:3]
            self._free_coordinates.set_motion(data, row, velocity, obstacle.turn_rate)
        self._free_headings = np.array([self.obstacles[name].heading for name in self._free])
        self._follow_paths(0)
        for machine in self._machines:
            machine.place(data, self._states[machine.number])
        mujoco.mj_forward(model, data)
        for actuator, _, part in self._parts:
            if actuator.group.model.heading is not None:
                self._inertia[part, 3] = self._upright.turning_inertias(model, part) / self.step_time
        self._touching = TouchingPairs(self._geometries.owners, len(self.roster) + len(self.obstacles) + 1)

    def close(self) -> None:
        """Release the engine's model."""
        for name in ("_bodies", "_data", "_model"):
            self.__dict__.pop(name, None)

    # -- agents that enter and leave

    def _appear(self, row: int, velocity: Sequence[float]) -> None:
        self._velocity[row, :3] = velocity
        self._upright.set_velocities(self._data, self._velocity[row], row)
        self._geometries.show(self._model, self.present)

    def _vanish(self, row: int) -> None:
        self._velocity[row] = 0.0
        self._upright.set_velocities(self._data, self._velocity[row], row)
        self._geometries.show(self._model, self.present)

    def _enter(self, group: EntityGroup, rows: Sequence[int]) -> None:
        number = self._number[group.name]
        if number not in self._bodies:
            super()._enter(group, rows)
            return
        vehicle, state = self._vehicle_of(number), self._states[number]
        for row in rows:
            self._bodies[number].put(row, *vehicle.pose(state[row]))
        vehicle.start(rows, state[list(rows)])
        self._geometries.show(self._model, self.present)

    def _leave(self, group: EntityGroup, rows: Sequence[int]) -> None:
        if self._number[group.name] not in self._bodies:
            super()._leave(group, rows)
            return
        self._geometries.show(self._model, self.present)

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

    # -- steps

    def _refresh(self) -> None:
        self._velocity = self._upright.velocities(self._data)

    def _push(self, forces: Array | None) -> None:
        """Set the velocities that the forces cause in this physics step, before contacts are solved."""
        self._push_vehicles()
        for bodies in self._bodies.values():
            bodies.turn_rotors()
        if forces is not None:
            self._upright.set_velocities(self._data, self._velocity)

    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        retained = (1.0 - self.parameters.damping) ** self.step_time
        while True:
            self._follow_paths(number)
            if retained != 1.0:
                self._free_coordinates.damp(self._data, retained)
            self._step_engine()
            raise_warnings(self._data)
            number += 1
            self._touching.follow(self._data, self._tracker, self.step_time)
            met = self._tracker.agents > 0
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
        coordinates, data = self._path_coordinates, self._data
        for row, name in enumerate(self._moving):
            course, obstacle = self._course(name, number), self.obstacles[name]
            x, y, z, w = attitude(obstacle.roll, obstacle.pitch, course.heading).tolist()
            height = course.position[2] if len(course.position) == 3 else coordinates.pose(data, row)[2]
            coordinates.set_pose(data, row, [*course.position[:2], height, w, x, y, z])
            coordinates.set_motion(data, row, [*course.velocity, 0.0][:3], course.turn_rate)

    def _find_overlaps(self) -> None:
        self._geometries.show(self._model, self.present)
        mujoco.mj_forward(self._model, self._data)
        try:
            raise_warnings(self._data)
        except EngineWarningError as error:
            raise WorldError(str(error), "environment") from error
        self._touching.begin(self._data, self._tracker)

    # -- states read from bodies

    def _read_driven(self) -> BodyStates:
        return self._upright.states(self._data)

    def _read_free(self) -> BodyStates:
        return self._free_coordinates.states(self._data, self._free_headings)

    def _machine_of(self, name: str) -> Motors | None:
        return next((each for each in self._machines if each.group.name == name), None)

    def _push_others(self, number: int, rows: Sequence[int], change: Array) -> None:
        if number not in self._bodies:
            raise NotImplementedError("robots with motors cannot be displaced")
        super()._push_others(number, rows, change)

    def _displace(self, row: int, moved: Array, turned: float, faster: Array) -> None:
        self._upright.change(self._data, row, [*moved.tolist(), turned], [*faster.tolist(), 0.0])

    def _placement(self) -> Mapping[str, Array]:
        return {"bodies": self._data.qpos.copy()}

    def _place(self, placement: Mapping[str, Array]) -> None:
        self._data.qpos[:] = placement["bodies"]
        mujoco.mj_forward(self._model, self._data)

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure horizontal rays against the bodies of the engine, from the heights of the senders."""
        levels = self.body_positions([self.roster.ids[sender] for sender in senders.tolist()])[:, 2]
        starts = np.column_stack([origins[:, :2], levels + height])
        return self._geometries.ray_cast(self._model, self._data, senders, starts, directions, reach)

    def in_sight(self, ones: Indices, others: Indices) -> Mask:
        """Test the lines between the centres of bodies against the shapes of the engine."""
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        middles, free = self.body_positions(self.roster.ids), np.ones(len(ones), bool)
        for row, (one, other) in enumerate(zip(ones.tolist(), others.tolist(), strict=True)):
            # Both directions share one line.
            start, end = middles[min(one, other)], middles[max(one, other)]
            free[row] = self._geometries.is_free(model, data, start, end)
        return free

    def camera_image(
        self, position: Sequence[float], target: Sequence[float], size: tuple[int, int], field_of_view: float
    ) -> Image:
        """Make an image from a position towards a target, by rays; no screen and no graphics library is needed."""
        return self._geometries.image(self._model, self._data, position, target, size, field_of_view)

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
            return self._upright.height(self._data, row)
        free = self._free_rows.get(name)
        return self._levels[name] if free is None else float(self._free_coordinates.pose(self._data, free)[2])

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
        pose = self._free_coordinates.pose(self._data, row)
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
        self._touching.forget_step()
        mujoco.mj_setState(self._model, self._data, state, _STATE)
        self._geometries.show(self._model, self.present)
        mujoco.mj_forward(self._model, self._data)
        # The solver's warm start is part of the state, and was just replaced.
        mujoco.mj_setState(self._model, self._data, state, _STATE)
