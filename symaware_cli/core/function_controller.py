"""Controllers that are one function."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import TimeSeries
from symaware_cli.core.families import Controller

#: A function of the agent's state, its knowledge and the time [s]; returns the control input.
ControlFunction = Callable[[NDArray[np.float64], Any, float], Any]


def controller(function: ControlFunction) -> type[Controller]:
    """Make a controller of one function: a decorator.

    The function gets the agent's belief of its own state (in the order of its model), its knowledge (by name) and
    simulated time [s], and returns the control input, in the order of the model. There is no intent.

    Args:
        function: The function.

    Raises:
        TypeError: It does not take three arguments.
    """
    try:
        inspect.signature(function).bind(None, None, None)
    except TypeError as error:
        name = getattr(function, "__name__", "it")
        raise TypeError(f"`{name}` takes (state, knowledge, time), to be a controller: {error}") from None

    def _compute(self: Controller) -> tuple[Any, TimeSeries]:
        agent = self._agent
        return function(agent.self_state, agent.self_knowledge, self.time), TimeSeries()

    made = {
        "__doc__": function.__doc__,
        "__module__": function.__module__,
        "__qualname__": function.__qualname__,
        "_compute": _compute,
        "__wrapped__": staticmethod(function),
    }
    return type(function.__name__, (Controller,), made)
