"""Worlds that hold the states of each group in columns: their base class, and one that replays a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli.core import Contact, EntityGroup, Environment, Obstacle, ScenarioView, Snapshot
from symaware_cli.engine.environments.contact_detector import ContactDetector
from symaware_cli.engine.environments.looks_check import warn_of_looks
from symaware_cli.geometry import Array, Pose
from symaware_cli.world import frozen


class ColumnEnvironment(Environment):
    """A world that holds, for each group, arrays of the true states and of the control inputs in force."""

    is_open = True
    is_shared = True

    def find_warnings(self, view: ScenarioView) -> None:
        """Warn of missing visual shapes of robots."""
        warn_of_looks(view, self.folder, self.further_folders)

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Set all groups to their initial states at time 0."""
        super().initialise(groups, obstacles, seed)
        self._time = 0
        self._number = {group.name: number for number, group in enumerate(self.groups)}
        self._models = [group.model for group in self.groups]
        self._states = [group.initial_state for group in self.groups]
        self._applied = [frozen(group.model.limit(group.control_input)) for group in self.groups]
        #: The velocities of all agents by index [m/s]; None if the models yield them.
        self._velocities: Array | None = None
        self._snapshot: Snapshot | None = None
        self._contacts: Sequence[Contact] | None = None

    def admit(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let absent agents enter, in their present states."""
        self._count_present()
        self._snapshot = None

    def dismiss(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents leave; their states stay as they are."""
        self._count_present()
        self._snapshot = None

    def overlaps(self, id: str) -> Sequence[str]:
        """Return the names of the agents and obstacles that an agent's body overlaps now, as seen from above."""
        detector = ContactDetector(self.groups, self.scenery, self.proximity)
        touching = [(each.first, each.second) for each in detector.update(self.snapshot(), self.scenery)]
        return sorted(other for pair in touching if id in pair for other in pair if other != id)

    def _apply_inputs(self) -> None:
        """Saturate the control inputs that the groups request, and store them for the step."""
        for number, group in enumerate(self.groups):
            applied = group.model.limit(group.control_input)
            applied.setflags(write=False)
            self._applied[number] = applied

    def state(self, group: EntityGroup) -> Array:
        """Return the true states of a group, read-only; shape (n, nx)."""
        return self._states[self._number[group.name]]

    def applied_input(self, group: EntityGroup) -> Array:
        """Return the control inputs of the last step after saturation, read-only; shape (n, nu)."""
        return self._applied[self._number[group.name]]

    def snapshot(self) -> Snapshot:
        """Return the whole world now; all callers within a step share one object."""
        if self._snapshot is None:
            self._snapshot = Snapshot(
                self._time,
                self.roster,
                self._models,
                self._states,
                self._applied,
                self._velocities,
                self.present,
            )
        return self._snapshot

    def share(self) -> Mapping[str, Array]:
        """Return the states of all groups, and their control inputs in force."""
        states = {f"state/{group.name}": state for group, state in zip(self.groups, self._states, strict=True)}
        return states | {f"input/{group.name}": given for group, given in zip(self.groups, self._applied, strict=True)}

    def follow(self, time: int, shared: Mapping[str, Array], contacts: Sequence[Contact]) -> None:
        """Adopt the state of the world of another process.

        Raises:
            ValueError: The arrays are not of a world like this one.
        """
        self._states = [shared_array(shared, f"state/{group.name}", group.initial_state.shape) for group in self.groups]
        self._applied = [
            shared_array(shared, f"input/{group.name}", group.control_input.shape) for group in self.groups
        ]
        self._time = time
        self._snapshot, self._contacts = None, tuple(contacts)


def shared_array(shared: Mapping[str, Array], name: str, shape: tuple[int, ...]) -> Array:
    """Return one of the shared arrays, read-only.

    Raises:
        ValueError: No array has this name and shape.
    """
    values = shared.get(name)
    if values is None or values.shape != shape:
        raise ValueError(f"the shared state of the world has no `{name}` of shape {shape}")
    values.flags.writeable = False
    return values


class RecordedEnvironment(ColumnEnvironment):
    """Replaces another world: it adopts the states recorded there, and moves nothing by itself."""

    can_return = True

    def __init__(self, original: Environment) -> None:
        """Replace a world that has not been initialised.

        Args:
            original: The world to replace.
        """
        super().__init__()
        self.time_step = original.time_step
        self.debounce = original.debounce
        self.folder, self.further_folders = original.folder, original.further_folders
        self.ground = original.ground
        self.provides = original.provides  # type: ignore[misc]
        self._poses: dict[str, Pose] = {}

    def show(
        self, time: int, states: Mapping[str, Array], inputs: Mapping[str, Array], poses: Mapping[str, Pose]
    ) -> None:
        """Adopt recorded states.

        Args:
            time: The instant, in nanoseconds.
            states: The true states of groups that changed.
            inputs: The control inputs that were applied.
            poses: The poses of entities that moved.
        """
        self._poses.update(poses)
        for name, state in states.items():
            state.flags.writeable = False
            self._states[self._number[name]] = state
        for name, applied in inputs.items():
            applied.flags.writeable = False
            self._applied[self._number[name]] = applied
        self._time = time
        self._count_present()
        self._snapshot = None

    def pose(self, name: str) -> Pose:
        """Return the pose of an obstacle: that recorded last, if it was recorded."""
        return self._poses[name] if name in self._poses else super().pose(name)

    def step(self) -> None:
        """Refuse: the next states are in the log."""
        raise NotImplementedError("a recorded world cannot be stepped")

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Refuse: sudden changes are in the recorded states. Scenarios whose faults cause them can still be checked."""
        raise NotImplementedError("a recorded world cannot be pushed")
