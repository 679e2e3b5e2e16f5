"""What can be put away of an object, so that another one like it can go on from there."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar, Protocol


class StateError(Exception):
    """The state of a simulation cannot be taken, or not be put where it was to go; nothing was changed."""


class Stateful(Protocol):
    """What a class declares of whose objects not every attribute can be put away by value.

    All attributes are put away, with whatever they refer to, but for those that ``uncaptured`` names; an object whose
    class has these two methods says the rest itself.

    Attributes:
        uncaptured: Names of attributes that hold no state: what follows from the scenario and never changes in a run,
            such as a solver that remembers nothing, or what belongs to the process, such as an open file. They stay
            what they are where a state is put back. ``*`` stands for all.
    """

    uncaptured: ClassVar[Collection[str]]

    def captured(self) -> Any:
        """Return the state that no attribute has, in numbers, texts, arrays, and lists and mappings of such.

        Raises:
            StateError: It cannot be told exactly at present, and why.
        """

    def check_state(self, state: Any) -> None:
        """See whether `restored` could take over a state, before anything is changed; may be left out.

        Raises:
            StateError: It could not, and why.
        """

    def restored(self, state: Any) -> None:
        """Take over a state that `captured` returned, once all attributes are what they were."""
