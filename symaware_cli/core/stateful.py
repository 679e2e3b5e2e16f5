"""The protocol of objects whose state can be captured and restored."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar, Protocol


class StateError(Exception):
    """The state of a simulation cannot be captured or restored; nothing was changed."""


class Stateful(Protocol):
    """A class whose objects have attributes that cannot be captured by value.

    All attributes are captured, with everything they refer to, except those that ``uncaptured`` names. The methods
    `captured` and `restored` handle the rest.

    Attributes:
        uncaptured: Names of attributes without state: those that follow from the scenario and never change in a run,
            such as a stateless solver, or belong to the process, such as an open file. They are left unchanged when a
            state is restored. ``*`` stands for all.
    """

    uncaptured: ClassVar[Collection[str]]

    def captured(self) -> Any:
        """Return the state that is not in captured attributes: numbers, texts, arrays, lists and mappings of these.

        Raises:
            StateError: It cannot be captured exactly at present; the message gives the reason.
        """

    def check_state(self, state: Any) -> None:
        """Check whether `restored` can restore a state, before anything is changed; optional.

        Raises:
            StateError: It cannot; the message gives the reason.
        """

    def reseed(self, seed: int) -> None:
        """Take another seed for all further draws; optional, for objects that keep the seed of the run or keys of it.

        A state may be restored with another seed, so that later draws differ. Generators that components get as
        `random` do this by themselves.
        """

    def restored(self, state: Any) -> None:
        """Restore a state that `captured` returned, after all attributes were restored."""
