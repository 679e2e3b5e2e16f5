"""A world that replays the recorded states of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli.core import EntityGroup, Environment
from symaware_cli.environments.column_environment import Array, ColumnEnvironment


class RecordedEnvironment(ColumnEnvironment):
    """Replaces another world: it adopts the states recorded there, and moves nothing by itself."""

    def __init__(self, original: Environment) -> None:
        """Replace a world that has not been initialised.

        Args:
            original: The world to replace.
        """
        super().__init__()
        self.time_step = original.time_step
        self.folder = original.folder
        self.ground = original.ground
        self.provides = original.provides  # type: ignore[misc]

    def show(self, time: int, states: Mapping[str, Array], inputs: Mapping[str, Array]) -> None:
        """Adopt recorded states.

        Args:
            time: The instant, in nanoseconds.
            states: The true states of groups that changed.
            inputs: The control inputs that were applied.
        """
        for name, state in states.items():
            state.flags.writeable = False
            self._states[self._number[name]] = state
        for name, applied in inputs.items():
            applied.flags.writeable = False
            self._applied[self._number[name]] = applied
        self._time = time
        self._count_present()
        self._snapshot = None

    def step(self) -> None:
        """Refuse: the next states are in the log."""
        raise NotImplementedError("a recorded world cannot be stepped")

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Refuse: sudden changes are in the recorded states. Scenarios whose faults cause them can still be checked."""
        raise NotImplementedError("a recorded world cannot be pushed")
