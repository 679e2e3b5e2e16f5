"""Base class of physics worlds: time steps in physics steps, forces by actuators, and states read from bodies.

Reasons: docs/decisions/0014-physics-worlds.md
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, NamedTuple, NoReturn

import numpy as np
from pydantic import Field

from symaware_cli.core import (
    Contact,
    Drive,
    EntityGroup,
    EnvironmentParameters,
    ErrorCollector,
    Obstacle,
    Pose,
    Scenery,
    WorldError,
    seconds,
)
from symaware_cli.core.stateful import StateError
from symaware_cli.engine import Actuator, ColumnEnvironment, shared_array
from symaware_cli.geometry import Array
from symaware_cli.worlds.contact_tracker import GROUND, ContactTracker


class BodyStates(NamedTuple):
    """Poses and velocities of bodies, a row for each.

    Attributes:
        positions: [m]; shape (m, d).
        headings: Counting turns [rad]; shape (m,).
        motion: Velocities [m/s], and in the last column turn rates about the vertical [rad/s]; shape (m, d + 1).
        orientations: Quaternions (x, y, z, w), if bodies turn about more than the vertical; shape (m, 4).
    """

    positions: Array
    headings: Array
    motion: Array
    orientations: Array | None = None


class OpaqueEngine:
    """A part of worlds whose engine does not save all of its state, at least not for another process."""

    uncaptured: ClassVar[Collection[str]] = "*"

    def captured(self) -> NoReturn:
        """Refuse.

        Raises:
            StateError: Always.
        """
        raise StateError("its engine does not expose all of its state; the kinematic world does")

    def restored(self, state: object) -> None:
        """Do nothing; never called, as no state is captured."""


class PhysicsEnvironment(ColumnEnvironment):
    """A world in which forces move bodies.

    A time step has a number of physics steps. In each, the actuator of an agent applies the force and the torque that
    give its body the velocity of the model, within `max_force` and `max_torque` of the body; gravity and damping act on
    free bodies only. The resulting poses and velocities are read back into the states of the agents.

    Attributes:
        dimensions: The largest number of coordinates of a position.
        step_time: Duration of a physics step [s].
    """

    dimensions: ClassVar[int]
    provides: ClassVar[Sequence[str]] = ("forces",)

    class Parameters(EnvironmentParameters):
        """Parameters of a physics world."""

        debounce: float = Field(
            0.1,
            ge=0,
            le=1e6,
            description="How long two bodies must be apart until their contact has ended [s]; if they touch again "
            "before, it continues. Engines separate bodies that push each other for single physics steps.",
        )
        substeps: int = Field(10, ge=1, le=1000, description="How many physics steps a time step is divided into.")
        damping: float = Field(
            0.0, ge=0, lt=1, description="Part of its velocity that a free body loses in a second, moving and turning."
        )

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Create all bodies in their initial states.

        Raises:
            ValueError: An obstacle has the name of a group.
            WorldError: The world does not support a model or an entity.
        """
        super().initialise(groups, obstacles, seed)
        self.step_time = seconds(self.time_step) / self.parameters.substeps
        errors = ErrorCollector()
        self._actuators: list[Actuator | None] = []
        for group in self.groups:
            with errors.catch():
                if group.model.mechanism() is not None and "mechanisms" not in self.provides:
                    raise WorldError(
                        "this world has no motors for the joints of a robot",
                        *("agents", group.name, "model"),
                        needs="mechanisms",
                    )
                if len(group.model.position) > self.dimensions:
                    raise WorldError(
                        f"a model that moves in {len(group.model.position)} dimensions cannot move in a plane",
                        *("agents", group.name, "model"),
                    )
                self._actuators.append(self._actuator(group, seed))
        errors.raise_first()
        self._width = max((len(group.model.position) for group in self.groups), default=2)
        self._velocities: Array = np.zeros((len(self.roster), self._width))
        self._free = [name for name, obstacle in self.obstacles.items() if obstacle.is_free]
        self._moving = [name for name, obstacle in self.obstacles.items() if obstacle.path]
        self._free_rows = {name: row for row, name in enumerate(self._free)}
        self._free_known: BodyStates | None = None
        self._tracker = ContactTracker([*self.roster.ids, *self.obstacles, GROUND], len(self.roster))
        self._prepare()
        try:
            self._build()
            for row in self._absent:
                self._vanish(row)
            self._read()
            self._find_overlaps()
        except BaseException:
            self.close()
            raise

    def _actuator(self, group: EntityGroup, seed: int) -> Actuator | None:
        """Return the actuator of a group; None if its model moves the bodies itself."""
        return Actuator(group, self.time_step, self.parameters.substeps, seed)

    def _prepare(self) -> None:
        """Set up the arrays of the agents with an actuator, in the order of the roster."""
        driven = [actuator for actuator in self._actuators if actuator]
        counts = [len(actuator.group) for actuator in driven]
        count, width = sum(counts), self.dimensions + 1
        rows = [self.roster.start(actuator.group.name) + np.arange(len(actuator.group)) for actuator in driven]
        #: The roster's index of each agent with an actuator.
        self._driven = np.concatenate([np.empty(0, np.intp), *rows])
        starts = np.cumsum([0, *counts]).tolist()
        self._parts = [
            (actuator, self._number[actuator.group.name], slice(start, end))
            for actuator, start, end in zip(driven, starts, starts[1:], strict=False)
        ]
        #: Force or torque that changes the velocity by one unit in a physics step; shape (m, d + 1).
        self._inertia = np.zeros((count, width))
        self._adds = np.zeros((count, width), bool)
        self._limits = np.full((count, 2), np.inf)
        for actuator, _, part in self._parts:
            entity = actuator.group.entity
            self._inertia[part, :-1] = entity.mass / self.step_time
            self._adds[part, : len(actuator.group.model.position)] = actuator.adds
            for column, limit in enumerate((entity.max_force, entity.max_torque)):
                self._limits[part, column] = np.inf if limit is None else limit
        #: Whether the planned velocities are constant within a time step.
        self._steady = not any(actuator.turns or actuator.adds for actuator in driven)
        self._any_adds, self._any_limits = bool(self._adds.any()), bool(np.isfinite(self._limits).any())
        #: The last known velocities of the bodies; shape (m, d + 1).
        self._velocity = np.zeros((count, width))
        #: Whether `_push` must be called in each physics step, even without forces.
        self._pushes = False
        #: How much later than velocities the engine changes poses [s], and the greatest turn rate [rad/s].
        self._lag, self._greatest_turn_rate = 0.0, float("inf")
        #: The part of a velocity that the engine's damping leaves after a physics step.
        self._retained = 1.0
        #: The planned velocities, for each physics step or once for all.
        self._plan = np.zeros((1 if self._steady else self.parameters.substeps, count, width))

    @property
    def _absent(self) -> Sequence[int]:
        """The rows of absent agents with an actuator, ascending."""
        return [] if self.present is None else np.flatnonzero(~self.present[self._driven]).tolist()

    def admit(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let absent agents enter: their bodies collide from now on."""
        super().admit(group, rows)
        self._enter(group, rows)
        self._read_between_steps()

    def _enter(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let the bodies of agents appear."""
        velocities = np.zeros((len(group), self.dimensions))
        velocities[:, : len(group.model.velocities)] = group.initial_state[:, list(group.model.velocities)]
        for row in rows:
            self._appear(self._part_of(group).start + row, velocities[row].tolist())

    def dismiss(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents leave for good: their bodies do not collide any more."""
        super().dismiss(group, rows)
        self._leave(group, rows)
        self._read_between_steps()

    def _leave(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let the bodies of agents vanish."""
        for row in rows:
            self._vanish(self._part_of(group).start + row)

    def drive(self, group: EntityGroup) -> Drive:
        """Return the limits within which forces give bodies the velocities of their model.

        Raises:
            WorldError: The velocities also depend on a vehicle, links, damping or a joint.
        """
        entity, name = group.entity, group.name
        if not any(actuator.group is group for actuator, _, _ in self._parts):
            raise WorldError("its vehicle moves by wheels or rotors of its own", "agents", name, "model")
        if entity.shape and entity.shape.robot:
            raise WorldError("the links of a robot from a file move with the body", "agents", name, "entity", "shape")
        if self._retained != 1.0 and not (entity.max_force is None and entity.max_torque is None):
            said = f"`{'max_force' if entity.max_torque is None else 'max_torque'}` has to overcome the damping as well"
            raise WorldError(said, "environment", "with", "damping")
        part = self._part_of(group)
        inertia = float(self._inertia[part.start, -1]) * self.step_time
        return Drive(
            self.step_time,
            lag=self._lag,
            acceleration=np.inf if entity.max_force is None else entity.max_force / entity.mass,
            turn_acceleration=np.inf if entity.max_torque is None or not inertia else entity.max_torque / inertia,
            turn_rate=self._greatest_turn_rate,
            collides=entity.shape is not None,
        )

    def _part_of(self, group: EntityGroup) -> slice:
        return next(part for actuator, _, part in self._parts if actuator.group is group)

    @abstractmethod
    def _appear(self, row: int, velocity: Sequence[float]) -> None:
        """Make an agent's body appear at its initial pose, with a velocity [m/s]."""

    @abstractmethod
    def _vanish(self, row: int) -> None:
        """Stop an agent's body, and exclude it from collisions and rays."""

    @abstractmethod
    def _build(self) -> None:
        """Create all bodies in the engine."""

    @abstractmethod
    def _find_overlaps(self) -> None:
        """Report bodies that overlap at the start to the tracker."""

    @abstractmethod
    def _refresh(self) -> None:
        """Update `_velocity` of the bodies that the last physics step may have diverted."""

    @abstractmethod
    def _push(self, forces: Array | None) -> None:
        """Apply forces [N] and, in the last column, torques [N m] to the bodies with an actuator; none for None."""

    @abstractmethod
    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        """Make physics steps until a contact or joint may have diverted a body, and report contacts to the tracker.

        Args:
            number: The index, within the time step, of the first physics step.
            last: The index after the last physics step; greater than `number`.

        Returns:
            The index of the next physics step, and whether a body with an actuator may have been diverted.
        """

    @abstractmethod
    def _read_driven(self) -> BodyStates:
        """Read the bodies with an actuator."""

    @abstractmethod
    def _read_free(self) -> BodyStates:
        """Read the free bodies; called on demand only, so it must not change anything."""

    def step(self) -> None:
        """Advance by one time step, that is by `substeps` physics steps, under the saturated control inputs."""
        self._apply_inputs()
        self._plan_velocities()
        self._plan[:, self._absent] = 0.0
        settled = diverted = False
        at_once, substeps = not self._any_limits and self._retained == 1.0, self.parameters.substeps
        number = 0
        while number < substeps:
            if diverted:
                self._refresh()
            # Bodies that have their planned velocities, and keep them, need no force until something diverts them.
            forces = None if settled and not diverted else self._forces(number)
            settled = self._steady and (forces is None or at_once)
            if forces is not None or self._pushes:
                self._push(forces)
            number, diverted = self._advance(number, substeps if settled and not self._pushes else number + 1)
        self._add_process_noise(self._time)
        self._time += self.time_step
        self._tracker.end_time_step()
        self._read()

    def _add_process_noise(self, time: int) -> None:
        """Add the process noise of the step that began at a time [ns] to groups without an actuator."""

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Displace the bodies of some agents instantaneously, and change their velocities."""
        number, model = self._number[group.name], group.model
        part = next((part for _, driven, part in self._parts if driven == number), None)
        if part is None:
            self._push_others(number, rows, change)
        else:
            moved, faster = np.zeros(self.dimensions), np.zeros(self.dimensions)
            moved[: len(model.position)] = change[list(model.position)]
            faster[: len(model.velocities)] = change[list(model.velocities)]
            turned = 0.0 if model.heading is None else float(change[model.heading])
            for row in rows:
                self._displace(part.start + row, moved, turned, faster)
        self._read_between_steps()

    def _read_between_steps(self) -> None:
        contacts = self._contacts
        self._read()
        # This does not change what began or ended with the last step.
        self._contacts = contacts

    @abstractmethod
    def _displace(self, row: int, moved: Array, turned: float, faster: Array) -> None:
        """Move an agent's body [m], turn it about the vertical [rad], and add to its velocity [m/s]."""

    def _push_others(self, number: int, rows: Sequence[int], change: Array) -> None:
        """Change the states of some agents of a group without an actuator."""

    def _plan_velocities(self) -> None:
        """Plan the velocities of the time step."""
        for actuator, number, part in self._parts:
            planned = actuator.plan(self._states[number], self._applied[number], self._time)
            dimensions = len(actuator.group.model.position)
            self._plan[:, part, :dimensions] = planned[..., :dimensions]
            if actuator.turns:
                self._plan[:, part, -1] = planned[..., -1]

    def _forces(self, number: int) -> Array | None:
        """Return the forces and torques of a physics step; None if none is needed."""
        now, wanted = self._velocity, self._plan[0 if self._steady else number]
        if not len(now):
            return None
        if self._any_adds:
            wanted = np.where(self._adds, now + wanted, wanted)
        change = wanted - (now if self._retained == 1.0 else self._retained * now)
        if not change.any():
            return None
        forces: Array = change * self._inertia
        if self._any_limits:
            size = np.sqrt((forces[:, :-1] * forces[:, :-1]).sum(axis=1))
            share = np.ones_like(forces)
            share[:, :-1] = np.minimum(1.0, self._limits[:, 0] / np.maximum(size, 1e-300))[:, None]
            share[:, -1] = np.minimum(1.0, self._limits[:, 1] / np.maximum(np.abs(forces[:, -1]), 1e-300))
            forces *= share
            wanted = self._retained * now + change * share
        self._velocity = wanted
        return forces

    def _read(self) -> None:
        """Read the states of all agents from the engine."""
        self._free_known = None
        driven = self._read_driven()
        velocities = np.zeros((len(self.roster), self._width))
        self._velocity = driven.motion
        for actuator, number, part in self._parts:
            moving = driven.motion[part]
            state = actuator.state(driven.positions[part], driven.headings[part], moving)
            if actuator.group.present is not None:
                state = np.where(actuator.group.present[:, None], state, self._states[number])
                state.flags.writeable = False
            self._states[number] = state
            start, dimensions = self.roster.starts[number], len(actuator.group.model.position)
            velocities[start : start + len(moving), :dimensions] = moving[:, :dimensions]
        self._read_others(velocities)
        velocities.flags.writeable = False
        self._velocities = velocities
        self._snapshot = self._contacts = None

    def share(self) -> Mapping[str, Array]:
        """Return the states of all groups, and the poses and velocities of all moving bodies."""
        free = self._free_bodies
        own = {"velocities": self._velocities, "free": np.column_stack([free.positions, free.headings, free.motion])}
        return {**super().share(), **own, **self._placement()}

    def follow(self, time: int, shared: Mapping[str, Array], contacts: Sequence[Contact]) -> None:
        """Adopt the state of the world of another process; the engine's bodies are moved for rays and pictures.

        Raises:
            ValueError: The arrays are not of a world like this one.
        """
        super().follow(time, shared, contacts)
        self._velocities = shared_array(shared, "velocities", self._velocities.shape)
        width = self.dimensions
        free = shared_array(shared, "free", (len(self._free), 2 * width + 2))
        self._place({name: shared_array(shared, name, known.shape) for name, known in self._placement().items()})
        turned = self._read_free().orientations if self._free else None
        self._free_known = BodyStates(free[:, :width], free[:, width], free[:, width + 1 :], turned)

    @abstractmethod
    def _placement(self) -> Mapping[str, Array]:
        """Return the poses of the engine's moving bodies, for `_place`."""

    @abstractmethod
    def _place(self, placement: Mapping[str, Array]) -> None:
        """Move the engine's bodies to the poses of those of another process."""

    @property
    def _free_bodies(self) -> BodyStates:
        """The free bodies, in the order of `_free`."""
        if self._free_known is None:
            self._free_known = self._read_free()
        return self._free_known

    def _read_others(self, velocities: Array) -> None:
        """Read the states of groups without an actuator, and write their velocities into those of all agents."""

    @property
    def scenery(self) -> Scenery:
        """The obstacles now; all callers within a step share one object."""
        names = [*self._free, *self._moving]
        if names and self._scenery.time != self._time:
            index = {name: number for number, name in enumerate(self._scenery.names)}
            self._scenery = self._scenery.moved(self._time, [(index[name], self.pose(name)) for name in names])
        return self._scenery

    def moves(self, name: str) -> bool:
        """Return whether an obstacle ever moves: along a path, or because it is free."""
        return name in self._free_rows or super().moves(name)

    def pose(self, name: str) -> Pose:
        """Return the pose and velocities of an obstacle now."""
        row = self._free_rows.get(name)
        if row is None:
            return self.obstacles[name].pose(seconds(self._time))
        bodies = self._free_bodies
        return Pose(
            tuple(bodies.positions[row].tolist()),
            float(bodies.headings[row]),
            tuple(bodies.motion[row, :-1].tolist()),
            float(bodies.motion[row, -1]),
        )

    def entity_poses(self, names: Sequence[str]) -> Array:
        """Return the poses of entities now; those of all free entities in one call."""
        if list(names) != self._free:
            return super().entity_poses(names)
        bodies = self._free_bodies
        columns = [bodies.positions, bodies.headings]
        if bodies.orientations is not None:
            columns.append(bodies.orientations)
        return np.column_stack(columns)

    def _course(self, name: str, number: int) -> Pose:
        """Return pose and velocities of an entity with a path at the beginning of a physics step of the time step."""
        obstacle = self.obstacles[name]
        assert obstacle.path is not None
        return obstacle.path.course(seconds(self._time) + number * self.step_time, self.step_time, obstacle.heading)

    def contacts(self) -> Sequence[Contact]:
        """Return the contacts that began or ended with the last step; before the first step those of the start."""
        if self._contacts is None:
            self._contacts = self._tracker.take_changes()
        return self._contacts
