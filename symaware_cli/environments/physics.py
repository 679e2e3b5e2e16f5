"""What physics worlds have in common: physics steps, actuators, and what is read back from bodies."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, NoReturn

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import (
    Contact,
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
from symaware_cli.environments.actuator import Actuator
from symaware_cli.environments.column_environment import ColumnEnvironment, followed
from symaware_cli.environments.contact_tracker import GROUND, ContactTracker

Array = NDArray[np.float64]


class BodyStates:
    """What a world reads of bodies, a row for each.

    Attributes:
        positions: [m]; shape (m, d).
        headings: Counting turns [rad]; shape (m,).
        motion: Velocities [m/s], and in the last column turn rates about the vertical [rad/s]; shape (m, d + 1).
        orientations: Quaternions (x, y, z, w), where bodies turn about more than the vertical; shape (m, 4).
    """

    __slots__ = ("headings", "motion", "orientations", "positions")

    def __init__(self, positions: Array, headings: Array, motion: Array, orientations: Array | None = None) -> None:
        self.positions = positions
        self.headings = headings
        self.motion = motion
        self.orientations = orientations


class PhysicsEnvironment(ColumnEnvironment):
    """A world in which forces move bodies.

    A time step has a number of physics steps. In each the actuator of an agent applies the force and the torque that
    bring its body to the velocity which its model says, as far as `max_force` and `max_torque` of the body allow;
    gravity and damping act on free bodies only. What became of the bodies is read back into the states of the agents.

    Attributes:
        dimensions: How many coordinates a position has at most.
        step_time: A physics step [s].
    """

    dimensions: ClassVar[int]

    uncaptured: ClassVar[Collection[str]] = "*"

    class Parameters(EnvironmentParameters):
        """How a physics world moves."""

        substeps: int = Field(10, ge=1, le=1000, description="How many physics steps a time step is divided into.")
        damping: float = Field(
            0.0, ge=0, lt=1, description="Part of its velocity that a free body loses in a second, moving and turning."
        )

    def captured(self) -> NoReturn:
        """Refuse: what engines let one save of themselves is not all that they go on from, in another process at least.

        Raises:
            StateError: Always.
        """
        raise StateError("its engine does not tell all that it goes on from; the kinematic world does")

    def restored(self, state: object) -> None:
        """Never called, as there is no state."""

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Put everybody in place.

        Raises:
            ValueError: An obstacle has the name of a group.
            WorldError: The world cannot do what a model or an entity asks of it.
        """
        super().initialise(groups, obstacles, seed)
        self.step_time = seconds(self.time_step) / self.parameters.substeps
        errors = ErrorCollector()
        self._actuators: list[Actuator | None] = []
        for group in self.groups:
            with errors.catch():
                if len(group.model.position) > self.dimensions:
                    raise WorldError(
                        f"a model that moves in {len(group.model.position)} dimensions has no place in a plane",
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
        """What moves a group; None where its model does that by itself."""
        return Actuator(group, self.time_step, self.parameters.substeps, seed)

    def _prepare(self) -> None:
        """Set up the arrays of those that have an actuator, in the order of the roster."""
        driven = [actuator for actuator in self._actuators if actuator]
        counts = [len(actuator.group) for actuator in driven]
        count, width = sum(counts), self.dimensions + 1
        rows = [self.roster.start(actuator.group.name) + np.arange(len(actuator.group)) for actuator in driven]
        #: The roster's index of each.
        self._driven = np.concatenate([np.empty(0, np.intp), *rows])
        starts = np.cumsum([0, *counts]).tolist()
        self._parts = [
            (actuator, self._number[actuator.group.name], slice(start, end))
            for actuator, start, end in zip(driven, starts, starts[1:], strict=False)
        ]
        #: What a force or torque must be for each unit of velocity that it adds in a physics step; shape (m, d + 1).
        self._inertia = np.zeros((count, width))
        self._adds = np.zeros((count, width), bool)
        self._limits = np.full((count, 2), np.inf)
        for actuator, _, part in self._parts:
            entity = actuator.group.entity
            self._inertia[part, :-1] = entity.mass / self.step_time
            self._adds[part, : len(actuator.group.model.position)] = actuator.adds
            for column, limit in enumerate((entity.max_force, entity.max_torque)):
                self._limits[part, column] = np.inf if limit is None else limit
        #: Whether the velocities that are wanted stay the same within a time step.
        self._steady = not any(actuator.turns or actuator.adds for actuator in driven)
        self._any_adds, self._any_limits = bool(self._adds.any()), bool(np.isfinite(self._limits).any())
        #: The velocities that bodies have, as far as is known without asking; shape (m, d + 1).
        self._velocity = np.zeros((count, width))
        #: Whether there is something to apply in each physics step, forces or not.
        self._pushes = False
        #: The part of a velocity that the engine's damping leaves after a physics step.
        self._retained = 1.0
        #: The velocities that bodies are to have, for each physics step or once for all.
        self._plan = np.zeros((1 if self._steady else self.parameters.substeps, count, width))

    @property
    def _absent(self) -> Sequence[int]:
        """Which of those that have an actuator are not there, ascending."""
        return [] if self.present is None else np.flatnonzero(~self.present[self._driven]).tolist()

    def admit(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents enter who were not there: their bodies meet others from now on."""
        super().admit(group, rows)
        velocities = np.zeros((len(group), self.dimensions))
        velocities[:, : len(group.model.velocities)] = group.initial_state[:, list(group.model.velocities)]
        for row in rows:
            self._appear(self._part_of(group).start + row, velocities[row].tolist())
        self._read_between_steps()

    def dismiss(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents leave for good: their bodies meet nobody any more."""
        super().dismiss(group, rows)
        for row in rows:
            self._vanish(self._part_of(group).start + row)
        self._read_between_steps()

    def _part_of(self, group: EntityGroup) -> slice:
        return next(part for actuator, _, part in self._parts if actuator.group is group)

    @abstractmethod
    def _appear(self, row: int, velocity: Sequence[float]) -> None:
        """Let what is driven be there, where it was when it was built, with a velocity [m/s]."""

    @abstractmethod
    def _vanish(self, row: int) -> None:
        """Let what is driven stand still and meet nobody, nor any ray."""

    @abstractmethod
    def _build(self) -> None:
        """Make all bodies in the engine."""

    @abstractmethod
    def _find_overlaps(self) -> None:
        """Tell the tracker who overlaps at the start."""

    @abstractmethod
    def _refresh(self) -> None:
        """Read the velocities of those that the last physics step may have diverted into `_velocity`."""

    @abstractmethod
    def _push(self, forces: Array | None) -> None:
        """Apply forces [N] and, in the last column, torques [N m] to what is driven; none at all for None."""

    @abstractmethod
    def _advance(self, number: int, last: int) -> tuple[int, bool]:
        """Make physics steps until something may have diverted what is driven, and tell the tracker of contacts.

        Args:
            number: The number in the time step of the first one; there is at least one.
            last: That of the one after the last.

        Returns:
            The number of the one that is next, and whether something may have diverted what is driven.
        """

    @abstractmethod
    def _read_driven(self) -> BodyStates:
        """Read what is driven."""

    @abstractmethod
    def _read_free(self) -> BodyStates:
        """Read what is free; only if somebody asks, so that must make no difference."""

    def step(self) -> None:
        """Advance by one time step: so many physics steps under the saturated control inputs."""
        self._apply_inputs()
        self._lay_out()
        self._plan[:, self._absent] = 0.0
        settled = diverted = False
        at_once, substeps = not self._any_limits and self._retained == 1.0, self.parameters.substeps
        number = 0
        while number < substeps:
            if diverted:
                self._refresh()
            # Who has the velocity that it wants, and keeps wanting it, needs no force until something diverts it.
            forces = None if settled and not diverted else self._forces(number)
            settled = self._steady and (forces is None or at_once)
            if forces is not None or self._pushes:
                self._push(forces)
            number, diverted = self._advance(number, substeps if settled and not self._pushes else number + 1)
        self._shake(self._time)
        self._time += self.time_step
        self._tracker.settle()
        self._read()

    def _shake(self, time: int) -> None:
        """Add the noise of a step that began then [ns] to groups without an actuator."""

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Put the bodies of some agents elsewhere all at once, and give them another velocity."""
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
        # What began or ended with the last step is no other for that.
        self._contacts = contacts

    @abstractmethod
    def _displace(self, row: int, moved: Array, turned: float, faster: Array) -> None:
        """Put one that is driven elsewhere [m], turn it about the vertical [rad], and add to its velocity [m/s]."""

    def _push_others(self, number: int, rows: Sequence[int], change: Array) -> None:
        """Change the states of some agents of a group without an actuator."""

    def _lay_out(self) -> None:
        """Plan the velocities of the time step."""
        for actuator, number, part in self._parts:
            planned = actuator.plan(self._states[number], self._applied[number], self._time)
            dimensions = len(actuator.group.model.position)
            self._plan[:, part, :dimensions] = planned[..., :dimensions]
            if actuator.turns:
                self._plan[:, part, -1] = planned[..., -1]

    def _forces(self, number: int) -> Array | None:
        """The forces and torques of a physics step; None if none is needed."""
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
        """Take over what the engine made of everything."""
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
        """Take what all worlds take, how free bodies move, and where the engine has everything."""
        free = self._free_bodies
        own = {"velocities": self._velocities, "free": np.column_stack([free.positions, free.headings, free.motion])}
        return {**super().share(), **own, **self._placement()}

    def follow(self, time: int, shared: Mapping[str, Array], contacts: Sequence[Contact]) -> None:
        """Become as the world of another process is; the engine's bodies are put there for rays and pictures.

        Raises:
            ValueError: That is not of a world like this one.
        """
        super().follow(time, shared, contacts)
        self._velocities = followed(shared, "velocities", self._velocities.shape)
        width = self.dimensions
        free = followed(shared, "free", (len(self._free), 2 * width + 2))
        self._place({name: followed(shared, name, known.shape) for name, known in self._placement().items()})
        turned = self._read_free().orientations if self._free else None
        self._free_known = BodyStates(free[:, :width], free[:, width], free[:, width + 1 :], turned)

    @abstractmethod
    def _placement(self) -> Mapping[str, Array]:
        """Where the engine has the bodies that move, for `_place`."""

    @abstractmethod
    def _place(self, placement: Mapping[str, Array]) -> None:
        """Put the engine's bodies where those of another process are."""

    @property
    def _free_bodies(self) -> BodyStates:
        """What is free, in the order of `_free`."""
        if self._free_known is None:
            self._free_known = self._read_free()
        return self._free_known

    def _read_others(self, velocities: Array) -> None:
        """Take over the states of groups without an actuator, and put their velocities into those of all."""

    @property
    def scenery(self) -> Scenery:
        """The obstacles where they are now; shared by all who ask within a step."""
        names = [*self._free, *self._moving]
        if names and self._scenery.time != self._time:
            index = {name: number for number, name in enumerate(self._scenery.names)}
            self._scenery = self._scenery.moved(self._time, [(index[name], self.pose(name)) for name in names])
        return self._scenery

    def moves(self, name: str) -> bool:
        """Tell whether an obstacle ever moves: along a path, or because it is free."""
        return name in self._free_rows or super().moves(name)

    def pose(self, name: str) -> Pose:
        """Return where an obstacle is now."""
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
        """Where entities are now, and how they are turned; of those that are free all at once."""
        if list(names) != self._free:
            return super().entity_poses(names)
        bodies = self._free_bodies
        columns = [bodies.positions, bodies.headings]
        if bodies.orientations is not None:
            columns.append(bodies.orientations)
        return np.column_stack(columns)

    def _course(self, name: str, number: int) -> Pose:
        """Where something with a path is when a physics step of the time step begins, and how it moves in it."""
        obstacle = self.obstacles[name]
        assert obstacle.path is not None
        return obstacle.path.course(seconds(self._time) + number * self.step_time, self.step_time, obstacle.heading)

    def contacts(self) -> Sequence[Contact]:
        """The contacts that began or ended with the last step, and those of the start before the first."""
        if self._contacts is None:
            self._contacts = self._tracker.take()
        return self._contacts
