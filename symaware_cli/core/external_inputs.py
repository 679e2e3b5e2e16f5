"""Inputs from outside of a run, such as commands of another program: recorded in the log, and repeated from it.

Reasons: docs/decisions/0101-inputs-from-outside.md
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, ClassVar

ANSWER = "answer"
"""The key under which the log has an input."""

ERROR = "error"
"""The key under which the log has the reason why there was no input."""


class ExternalInputError(RuntimeError):
    """There is no usable input from outside."""


class ExternalInputs:
    """Takes the inputs of all components of a run from outside, or from the log of the run that is repeated."""

    uncaptured: ClassVar[Collection[str]] = ("_recorded", "_until")

    def __init__(self) -> None:
        self._recorded: Mapping[tuple[str, int], Sequence[Mapping[str, Any]]] | None = None
        self._until: int | None = None
        #: The instant of the last input of each component [ns], and the number of its inputs at that instant.
        self._taken: dict[str, tuple[int, int]] = {}

    def repeat(self, recorded: Mapping[tuple[str, int], Sequence[Mapping[str, Any]]], until: int | None = None) -> None:
        """Take the inputs from a log from now on.

        Args:
            recorded: The values that `take` returned, in order, by path and time [ns].
            until: The time from which on inputs come from outside again [ns]; None for the whole run from the log.
        """
        self._recorded, self._until = recorded, until

    def is_repeated(self, now: int) -> bool:
        """Whether inputs at a time [ns] come from a log."""
        return self._recorded is not None and (self._until is None or now < self._until)

    def take(self, source: str, now: int, ask: Callable[[], Any]) -> Mapping[str, Any]:
        """Return the next input of a component as it is logged: the value as `ANSWER`, or why there is none as `ERROR`.

        Args:
            source: The path of the component.
            now: The present time [ns].
            ask: Returns the input as plain JSON values; called unless the input comes from a log.

        Raises:
            ExternalInputError: The log that is repeated has no such input.
        """
        time, count = self._taken.get(source, (now, 0))
        number = count if time == now else 0
        self._taken[source] = now, number + 1
        if not self.is_repeated(now):
            return _asked(ask)
        assert self._recorded is not None
        found = self._recorded.get((source, now), ())
        if number >= len(found):
            raise ExternalInputError(f"the log that is repeated has no input of {source} at {now / 1e9:.9g} s")
        return found[number]


def _asked(ask: Callable[[], Any]) -> Mapping[str, Any]:
    try:
        # The value passes through JSON, so that a repetition gets the same: lists for tuples, texts for keys.
        answer: Any = json.loads(json.dumps(ask(), allow_nan=False))
    except Exception as error:
        return {ERROR: f"{error}" or type(error).__name__}
    return {ANSWER: answer}
