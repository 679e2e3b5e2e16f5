"""What all worlds share with those who follow them from another process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup

Array = NDArray[np.float64]


def captured_groups(groups: Sequence[AgentGroup], states: Sequence[Array], inputs: Sequence[Array]) -> dict[str, Array]:
    """The states of all groups, and their control inputs in force, by name."""
    named = [f"state/{group.name}" for group in groups], [f"input/{group.name}" for group in groups]
    return dict(zip([*named[0], *named[1]], [*states, *inputs], strict=True))


def adopted_groups(groups: Sequence[AgentGroup], captured: Mapping[str, Array]) -> tuple[list[Array], list[Array]]:
    """The states of all groups and their control inputs in force, read-only, as `captured_groups` put them.

    Raises:
        ValueError: They are not of these groups.
    """
    states = [adopted(captured, f"state/{group.name}", group.initial_state.shape) for group in groups]
    inputs = [adopted(captured, f"input/{group.name}", group.control_input.shape) for group in groups]
    return states, inputs


def adopted(captured: Mapping[str, Array], name: str, shape: tuple[int, ...]) -> Array:
    """One of the arrays that were captured, read-only.

    Raises:
        ValueError: There is none of this name and shape.
    """
    values = captured.get(name)
    if values is None or values.shape != shape:
        raise ValueError(f"there is no `{name}` of shape {shape} in what was captured of the world")
    values.flags.writeable = False
    return values
