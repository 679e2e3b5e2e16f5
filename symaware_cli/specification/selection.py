"""Selects rows from a structure of objects whose arrays have the rows along their last axis."""

from __future__ import annotations

import copy
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray


def selected(value: Any, rows: NDArray[np.intp], *, instances: tuple[type, ...]) -> Any:
    """Return a copy with the selected rows.

    Args:
        value: An array, a list, or an object of one of the classes with such attributes; anything else is shared.
        rows: The indices of the rows.
        instances: The classes whose instances are copied.
    """
    return _Selection(rows, instances).of(value)


class _Selection:
    def __init__(self, rows: NDArray[np.intp], instances: tuple[type, ...]) -> None:
        self.rows = rows
        self.instances = instances
        self.copies: dict[int, Any] = {}

    def of(self, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value[..., self.rows]
        if isinstance(value, list | deque):
            return type(value)(self.of(each) for each in value)
        if not isinstance(value, self.instances):
            return value
        if id(value) not in self.copies:
            made = self.copies[id(value)] = copy.copy(value)
            for name, each in vars(value).items():
                setattr(made, name, self.of(each))
        return self.copies[id(value)]
