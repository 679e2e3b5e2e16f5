"""What worlds have in common that hold the states of each group in columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Contact, EntityGroup, Environment, Obstacle, Snapshot
from symaware_cli.environments.contact_detector import ContactDetector

Array = NDArray[np.float64]


class ColumnEnvironment(Environment):
    """A world that holds the true states and the control inputs in force of each group in an array."""

    is_open = True
    is_shared = True

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Put everybody into the state of the beginning, at time 0."""
        super().initialise(groups, obstacles, seed)
        self._time = 0
        self._number = {group.name: number for number, group in enumerate(self.groups)}
        self._models = [group.model for group in self.groups]
        self._states = [group.initial_state for group in self.groups]
        self._applied = [group.model.limit(group.control_input) for group in self.groups]
        #: The velocities of all agents by index [m/s]; None for what the models say.
        self._velocities: Array | None = None
        self._snapshot: Snapshot | None = None
        self._contacts: Sequence[Contact] | None = None

    def admit(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents enter who were not there, in their initial states."""
        self._count_present()
        self._snapshot = None

    def dismiss(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents leave for good; their states stay as they are."""
        self._count_present()
        self._snapshot = None

    def overlaps(self, id: str) -> Sequence[str]:
        """The agents and obstacles that the body of an agent overlaps now, by name, as seen from above."""
        detector = ContactDetector(self.groups, self.scenery, self.proximity)
        touching = [(each.first, each.second) for each in detector.update(self.snapshot(), self.scenery)]
        return sorted(other for pair in touching if id in pair for other in pair if other != id)

    def _apply_inputs(self) -> None:
        """Saturate the control inputs that the groups request, and hold them for a step."""
        for number, group in enumerate(self.groups):
            applied = group.model.limit(group.control_input)
            applied.flags.writeable = False
            self._applied[number] = applied

    def state(self, group: EntityGroup) -> Array:
        """The true states of a group, read-only; shape (n, nx)."""
        return self._states[self._number[group.name]]

    def applied_input(self, group: EntityGroup) -> Array:
        """The control inputs of the last step after saturation, read-only; shape (n, nu)."""
        return self._applied[self._number[group.name]]

    def snapshot(self) -> Snapshot:
        """The whole world now; shared by all who ask within a step."""
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
        """Take the states of all groups, and their control inputs in force."""
        states = {f"state/{group.name}": state for group, state in zip(self.groups, self._states, strict=True)}
        return states | {f"input/{group.name}": given for group, given in zip(self.groups, self._applied, strict=True)}

    def follow(self, time: int, shared: Mapping[str, Array], contacts: Sequence[Contact]) -> None:
        """Become as the world of another process is.

        Raises:
            ValueError: That is not of a world like this one.
        """
        self._states = [followed(shared, f"state/{group.name}", group.initial_state.shape) for group in self.groups]
        self._applied = [followed(shared, f"input/{group.name}", group.control_input.shape) for group in self.groups]
        self._time = time
        self._snapshot, self._contacts = None, tuple(contacts)


def followed(shared: Mapping[str, Array], name: str, shape: tuple[int, ...]) -> Array:
    """One of the arrays that were shared, read-only.

    Raises:
        ValueError: There is none of this name and shape.
    """
    values = shared.get(name)
    if values is None or values.shape != shape:
        raise ValueError(f"there is no `{name}` of shape {shape} in what was shared of the world")
    values.flags.writeable = False
    return values
