"""Files of actions: the control inputs that were given to agents in an episode, so that its run can be repeated.

A line has the step, the agent, and its control input, whose numbers are exact: `12,robot.0,0.5,-0.25`. Lines are in
the order of steps, and of agents within a step. An agent without a line at a step is driven by its components.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup

Array = NDArray[np.float64]

#: The control inputs of some agents of a group at one step: a mask of the rows, and values for all rows.
Given = tuple[NDArray[np.bool_], Array]

_FIRST = "# SymAware actions 1"

#: The greatest size of a file, in bytes.
LARGEST = 2**28


class InputFileError(ValueError):
    """A file of actions cannot be used; the message gives the line.

    Attributes:
        is_missing: Whether there is no such file.
    """

    def __init__(self, message: str, is_missing: bool = False) -> None:
        super().__init__(message)
        self.is_missing = is_missing


class GivenInput(NamedTuple):
    """The control input of an agent at a step."""

    step: int
    agent: str
    values: tuple[float, ...]


def written(steps: Sequence[Mapping[AgentGroup, Given]]) -> bytes:
    """Write the actions of an episode as the content of a file.

    Args:
        steps: The control inputs given at each step.
    """

    def lines() -> Iterator[str]:
        yield _FIRST
        for step, given in enumerate(steps):
            for group, (mask, values) in given.items():
                for row in np.flatnonzero(mask).tolist():
                    yield ",".join([str(step), group.ids[row], *map(repr, values[row].tolist())])

    return ("\n".join(lines()) + "\n").encode()


class GivenInputs:
    """The content of a file of actions.

    Attributes:
        name: The path of the file below the scenario's folder.
        content: The content of the file.
        entries: The lines of the file.
    """

    #: It follows from the scenario.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, name: str, content: bytes) -> None:
        """Parse a file.

        Raises:
            InputFileError: The content is no file of actions.
        """
        self.name = name
        self.content = content
        self.entries = tuple(_parsed(name, content))

    @classmethod
    def read(cls, folder: Path, name: str) -> GivenInputs:
        """Read a file.

        Args:
            folder: The folder of the scenario.
            name: The path of the file below that folder.

        Raises:
            InputFileError: There is no such file, or it is no file of actions.
        """
        path = folder / name
        if not path.resolve().is_relative_to(folder.resolve()):
            raise InputFileError(f"{name}: it leads out of the scenario's folder")
        try:
            with path.open("rb") as file:
                content = file.read(LARGEST + 1)
        except OSError as error:
            raise InputFileError(f"there is no file {name}: {error.strerror}", is_missing=True) from error
        if len(content) > LARGEST:
            raise InputFileError(f"{name} is larger than {LARGEST:,} bytes")
        return cls(name, content)

    def problem(self, groups: Sequence[AgentGroup]) -> str | None:
        """Return the reason why the actions do not fit the agents of a scenario; None if they do."""
        sizes = {id: group.control_input.shape[1] for group in groups for id in group.ids}
        for number, each in enumerate(self.entries):
            if each.agent not in sizes:
                return f"{self.name}, line {number + 2}: there is no agent `{each.agent}`"
            if len(each.values) != sizes[each.agent]:
                said = f"{len(each.values)} numbers for the {sizes[each.agent]} control inputs of `{each.agent}`"
                return f"{self.name}, line {number + 2}: {said}"
        return None

    def overrides(self, groups: Sequence[AgentGroup]) -> InputSequence:
        """Return the actions as `Simulation.overrides`."""
        places = {id: (group, row) for group in groups for row, id in enumerate(group.ids)}
        steps: dict[int, dict[AgentGroup, Given]] = {}
        for each in self.entries:
            group, row = places[each.agent]
            given = steps.setdefault(each.step, {})
            if group not in given:
                given[group] = np.zeros(len(group), bool), np.zeros_like(group.control_input)
            mask, values = given[group]
            mask[row] = True
            values[row] = each.values
        return InputSequence(steps)


class InputSequence:
    """Control inputs for each step, as `Simulation.overrides`."""

    #: It follows from the scenario.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, steps: Mapping[int, Mapping[AgentGroup, Given]]) -> None:
        self._steps = steps

    def __call__(self, step: int) -> Mapping[AgentGroup, Given]:
        """Return the control inputs of a step."""
        return self._steps.get(step, {})


def _parsed(name: str, content: bytes) -> Iterator[GivenInput]:
    try:
        first, *lines = content.decode("ascii").splitlines()
    except (UnicodeDecodeError, ValueError):
        first, lines = "", []
    if first != _FIRST:
        raise InputFileError(f"{name} is no file of actions: it does not begin with `{_FIRST}`")
    before = (-1, "")
    taken: set[str] = set()
    for number, line in enumerate(lines, 2):
        step, *rest = line.split(",")
        if not step.isdecimal() or len(step) > 10 or len(rest) < 2:
            raise InputFileError(f"{name}, line {number}: not a step, an agent and its control input")
        agent, values = rest[0], tuple(map(_number, rest[1:]))
        if None in values:
            raise InputFileError(f"{name}, line {number}: a control input is not a finite number")
        if int(step) < before[0]:
            raise InputFileError(f"{name}, line {number}: step {step} follows step {before[0]}")
        if int(step) > before[0]:
            taken.clear()
        if agent in taken:
            raise InputFileError(f"{name}, line {number}: a second line for `{agent}` at step {step}")
        taken.add(agent)
        before = int(step), agent
        yield GivenInput(int(step), agent, tuple(each for each in values if each is not None))


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
