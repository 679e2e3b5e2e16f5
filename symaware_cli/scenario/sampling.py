"""Values for the agents of a group: one for all, one for each, or drawn from a seeded distribution.

What an agent draws is keyed by the seed of the run and the agent's own path, so adding agents changes nobody's value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import Model
from symaware_cli.core.random import generator
from symaware_cli.scenario.check import check, said_of
from symaware_cli.scenario.compose import Composition
from symaware_cli.scenario.document import Part
from symaware_cli.scenario.problem import Problem, nearest, quoted
from symaware_cli.scenario.source import Path

Array = NDArray[np.float64]
Plane = Annotated[list[float], Field(min_length=2, max_length=3)]


class Grid(Part):
    """Agents in rows and columns, in the order of their index."""

    origin: Plane = Field(default_factory=lambda: [0.0, 0.0], description="Position of the first agent [m].")
    spacing: float | Plane = Field(1.0, description="Distance between neighbours, the same or for each axis [m].")
    columns: int | None = Field(None, ge=1, description="Agents in a row; if left out, as many as there are rows.")
    heading: float = Field(0.0, description="Heading of all [rad], for models that have one.")


class Ring(Part):
    """Agents evenly on a circle, counter-clockwise in the order of their index."""

    centre: Plane = Field(default_factory=lambda: [0.0, 0.0], description="Centre [m].")
    radius: float = Field(gt=0, description="Radius [m].")
    phase: float = Field(
        0.0, description="Direction from the centre to the first agent [rad]; pi more is the far side."
    )
    heading: Literal["inward", "outward", "along"] = Field(
        "inward", description="Where agents look, for models that have a heading."
    )


Placement = TypeVar("Placement", Grid, Ring)

DISTRIBUTIONS = ("uniform", "normal", "grid", "circle")
FORMS = (*DISTRIBUTIONS, "each", "all")


class Sampler:
    """Gives each agent of one group its value.

    Attributes:
        problems: What was wrong with the values so far.
    """

    def __init__(
        self, composition: Composition, seed: int, ids: Sequence[str], indexed: bool, model: Model | None
    ) -> None:
        self.problems: list[Problem] = []
        self._composition = composition
        self._seed = seed
        self._ids = ids
        self._indexed = indexed
        self._model = model
        self._placements: dict[Path, Any] = {}

    def states(self, value: Any, path: Path) -> Array:
        """The initial state of each agent; shape (n, nx), or (n, 0) after a problem."""
        if self._model is None:
            return np.empty((len(self._ids), 0))
        width = len(self._model.state)
        if value is None:
            return np.zeros((len(self._ids), width))
        each = self._values(value, path, width)
        return np.array(each, float) if each else np.empty((len(self._ids), 0))

    def knowledge(self, value: Any, path: Path) -> list[Any]:
        """What each agent knows under one name; empty after a problem."""
        each = self._values(value, path, None)
        return [np.array(one, float) if _is_array(one) else one for one in each] if each else []

    def _values(self, value: Any, path: Path, width: int | None) -> list[Any] | None:
        """Give each agent its value, or None after a problem."""
        count = len(self._ids)
        form = self._form(value, path, width)
        if form is None:
            return None
        kind, content, inner = form
        if kind == "all":
            return self._collect(lambda row: self._value(content, inner, row, width))
        if kind == "each":
            if not isinstance(content, list) or len(content) != count:
                said = f"{len(content)} values" if isinstance(content, list) else said_of(content)
                agents = "1 agent" if count == 1 else f"{count} agents"
                self._report(
                    "wrong-count",
                    f"{quoted(_dotted(path))} gives {said} for {agents}",
                    inner,
                    expected=f"a list of {count}" + ("" if width else ", or {all: ...} for one value that all share"),
                )
                return None
            return self._collect(lambda row: self._value(content[row], (*inner, row), row, width), tolerance=10)
        return self._collect(lambda row: self._value(value, path, row, width))

    def _form(self, value: Any, path: Path, width: int | None) -> tuple[str, Any, Path] | None:
        """Tell one value for all from one for each."""
        if isinstance(value, Mapping):
            names = [name for name in value if name in FORMS]
            if names and len(value) == 1:
                return (
                    (names[0], value[names[0]], (*path, names[0]))
                    if names[0] in ("each", "all")
                    else ("drawn", value, path)
                )
            if names or width is not None:
                name = next((name for name in value if name not in FORMS), "")
                self._report(
                    "bad-distribution",
                    f"{quoted(_dotted(path))} is {said_of(value)} with {len(value)} keys"
                    if names
                    else f"unknown distribution {quoted(name)}",
                    (*path, name) if name else path,
                    key=bool(name),
                    expected=f"exactly one of {', '.join(FORMS)}",
                    suggestion=nearest(name, FORMS),
                )
                return None
            return "all", value, path
        nested = isinstance(value, list) and any(isinstance(one, list) for one in value)
        if nested and (self._indexed or width is not None):
            return "each", value, path
        if isinstance(value, list) and any(isinstance(one, Mapping) for one in value):
            return "drawn", value, path
        return "all", value, path

    def _collect(self, value_of: Callable[[int], Any], tolerance: int = 0) -> list[Any] | None:
        """Gather the value of every agent, giving up after as many problems as are worth reading."""
        before = len(self.problems)
        values = []
        for row in range(len(self._ids)):
            values.append(value_of(row))
            if len(self.problems) > before + tolerance:
                break
        return values if len(self.problems) == before else None

    def _value(self, value: Any, path: Path, row: int, width: int | None) -> Any:
        """One agent's value."""
        if isinstance(value, Mapping) and len(value) == 1 and next(iter(value)) in DISTRIBUTIONS:
            drawn = self._draw(value, path, row, width)
        elif isinstance(value, list) and any(isinstance(one, Mapping) for one in value):
            drawn = [
                self._draw(one, (*path, number), row, 1) if isinstance(one, Mapping) else one
                for number, one in enumerate(value)
            ]
        else:
            drawn = value
        if width is None or drawn is None:
            return drawn
        return self._state(drawn, path)

    def _state(self, value: Any, path: Path) -> Any:
        model = self._model
        assert model is not None
        names = ", ".join(f"{quantity.name} [{quantity.unit}]" for quantity in model.state)
        expected = f"{len(model.state)} numbers: {names}"
        if not isinstance(value, list | np.ndarray):
            self._report("wrong-type", f"the state is {said_of(value)}", path, expected=expected)
            return None
        for number, one in enumerate(value):
            if isinstance(one, bool) or not isinstance(one, int | float | np.floating):
                self._report(
                    "wrong-type",
                    f"element {number} of the state is {said_of(one)}",
                    (*path, number),
                    expected="a number",
                )
                return None
        if len(value) != len(model.state):
            self._report("wrong-length", f"the state has {len(value)} elements", path, expected=expected)
            return None
        return value

    def _draw(self, value: Mapping[str, Any], path: Path, row: int, width: int | None) -> Any:
        kind, content = next(iter(value.items())) if len(value) == 1 else ("", None)
        inner = (*path, kind)
        if kind in ("uniform", "normal"):
            return self._random(kind, content, inner, row, width)
        if kind in ("grid", "circle"):
            placed = self._grid(content, inner, row) if kind == "grid" else self._ring(content, inner, row)
            return None if placed is None else self._place(*placed, width)
        name = str(next(iter(value), ""))
        self._report(
            "bad-distribution",
            f"unknown distribution {quoted(name)}",
            (*path, name),
            key=True,
            expected=f"exactly one of {', '.join(DISTRIBUTIONS)}",
            suggestion=nearest(name, DISTRIBUTIONS),
        )
        return None

    def _random(self, kind: str, content: Any, path: Path, row: int, width: int | None) -> Any:
        meaning = "[low, high]" if kind == "uniform" else "[mean, standard deviation]"
        if not isinstance(content, list) or len(content) != 2 or not all(_is_number_or_vector(one) for one in content):
            self._report(
                "bad-distribution",
                f"{quoted(_dotted(path))} is {said_of(content)}",
                path,
                expected=f"{meaning}, each a number or a list of numbers",
            )
            return None
        first, second = (np.array(one, float) for one in content)
        if first.ndim and second.ndim and len(first) != len(second):
            self._report(
                "wrong-length", f"the two parts have {len(first)} and {len(second)} elements", path, expected="as many"
            )
            return None
        if kind == "uniform" and (first > second).any():
            self._report("out-of-range", "the low end lies above the high end", path, expected=meaning)
            return None
        if kind == "normal" and (second < 0).any():
            self._report("out-of-range", "the standard deviation is negative", path, expected="at least 0")
            return None
        size = max(first.size if first.ndim else 0, second.size if second.ndim else 0)
        # A single number for a whole state means: of every element.
        shape = size or (width if width and width > 1 else 0)
        source = generator(self._seed, f"agents.{self._ids[row]}.{'.'.join(str(part) for part in path[2:])}")
        unit = source.random(shape or 1) if kind == "uniform" else source.standard_normal(shape or 1)
        drawn = first + (second - first) * unit if kind == "uniform" else first + second * unit
        return drawn.tolist() if shape else float(drawn[0])

    def _grid(self, content: Any, path: Path, row: int) -> tuple[list[float], float] | None:
        """The position and heading of an agent on a grid."""
        grid = self._checked(Grid, content, path)
        if grid is None:
            return None
        columns = grid.columns or math.ceil(math.sqrt(len(self._ids)))
        spacing = grid.spacing if isinstance(grid.spacing, list) else [grid.spacing] * 2
        steps = (row % columns, row // columns)
        position = list(grid.origin)
        for axis in range(2):
            position[axis] += steps[axis] * spacing[axis]
        return position, grid.heading

    def _ring(self, content: Any, path: Path, row: int) -> tuple[list[float], float] | None:
        """The position and heading of an agent on a circle."""
        ring = self._checked(Ring, content, path)
        if ring is None:
            return None
        angle = ring.phase + 2 * math.pi * row / len(self._ids)
        turn = {"inward": math.pi, "outward": 0.0, "along": math.pi / 2}[ring.heading]
        position = list(ring.centre)
        position[0] += ring.radius * math.cos(angle)
        position[1] += ring.radius * math.sin(angle)
        return position, math.remainder(angle + turn, 2 * math.pi)

    def _checked(self, kind: type[Placement], content: Any, path: Path) -> Placement | None:
        """Validate what is said of a placement, once for all agents."""
        if path not in self._placements:
            checked = check(kind, content, self._composition, path)
            if isinstance(checked, list):
                self.problems += checked
            self._placements[path] = None if isinstance(checked, list) else checked
        placement: Placement | None = self._placements[path]
        return placement

    def _place(self, position: list[float], heading: float, width: int | None) -> list[float]:
        """Put a position into a state, the rest of which is zero; elsewhere a position stands for itself."""
        model = self._model
        if width is None or model is None:
            return position
        state = [0.0] * width
        for index, coordinate in zip(model.position, position, strict=False):
            state[index] = coordinate
        if model.heading is not None:
            state[model.heading] = heading
        return state

    def _report(
        self,
        code: str,
        message: str,
        path: Path,
        *,
        key: bool = False,
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        problem = self._composition.problem(code, message, path, key=key, expected=expected, suggestion=suggestion)
        if problem not in self.problems:
            self.problems.append(problem)


def _dotted(path: Path) -> str:
    return ".".join(str(part) for part in path)


def _is_number_or_vector(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(_is_number(one) for one in value)
    return _is_number(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_array(value: Any) -> bool:
    """Whether a value is a list of numbers, or of lists of numbers of one length."""
    if not isinstance(value, list) or not value:
        return False
    if all(_is_number(one) for one in value):
        return True
    return all(isinstance(one, list) and _is_array(one) and len(one) == len(value[0]) for one in value)
