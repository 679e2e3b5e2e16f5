"""Models."""

from collections.abc import Sequence
from typing import Any

from symaware_cli import Model, Quantity


class Line(Model):
    """A point on a line, whose state is a single number."""

    state = (Quantity("x", "m"),)
    control_input = (Quantity("velocity", "m/s"),)
    position = (0,)

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """X' = u."""
        return (control_input[0],)
