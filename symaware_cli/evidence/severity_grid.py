"""Grids of severities: values of a degradation from mild to severe, and the places of a scenario that take them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from symaware_cli.language import Problem, ScenarioError, TextSpan, dotted, nearest
from symaware_cli.language.build import Built
from symaware_cli.studies import alternatives, varied

#: The maximum number of levels; more are taken for a mistake.
_MOST = 1000


@dataclass(frozen=True, slots=True)
class Degradation:
    """A kind of degradation that has a name of its own.

    Attributes:
        description: The values that it sets, with their unit.
        places: Finds these values in a scenario, by their paths.
        grid: The default values; None if they are shares of the values in the scenario.
        is_ascending: Whether greater values are more severe.
        lacking: The reason why a scenario has no such values, for messages.
    """

    description: str
    places: Callable[[Built], Iterator[tuple[str, Any]]]
    grid: str | None
    is_ascending: bool
    lacking: str


def _of_perception(parameter: str) -> Callable[[Built], Iterator[tuple[str, Any]]]:
    """Return a function that finds a parameter of the components that perceive."""

    def places(built: Built) -> Iterator[tuple[str, Any]]:
        for entry in built.simulation.entries:
            value = getattr(entry.components[0].parameters, parameter, None)
            if entry.use.startswith("perception.") and value is not None:
                yield dotted((*entry.section, "with", parameter)), value

    return places


def _of_channel(parameter: str) -> Callable[[Built], Iterator[tuple[str, Any]]]:
    """Return a function that finds a parameter of the channel of all links."""

    def places(built: Built) -> Iterator[tuple[str, Any]]:
        if built.document.topology is not None:
            yield f"topology.channel.{parameter}", getattr(built.document.topology.channel, parameter)

    return places


DEGRADATIONS: Mapping[str, Degradation] = {
    "noise": Degradation(
        "the position noise of all perception [m]",
        _of_perception("position_noise"),
        "0..1 by 0.1",
        True,
        "no perception has a `position_noise`",
    ),
    "delay": Degradation(
        "the delay of all links [s]", _of_channel("delay"), "0..1 by 0.1", True, "the scenario has no `topology`"
    ),
    "loss": Degradation(
        "the share of messages that all links lose",
        _of_channel("loss"),
        "0..0.9 by 0.1",
        True,
        "the scenario has no `topology`",
    ),
    "range": Degradation(
        "the range of all perception [m]", _of_perception("range"), None, False, "no perception has a `range`"
    ),
}


@dataclass(frozen=True, slots=True)
class SeverityGrid:
    """The values of a degradation, from mild to severe.

    Attributes:
        name: Its name, or the path of the value that it changes.
        paths: The paths of all values that it changes.
        values: The levels in the order of their tests.
    """

    name: str
    paths: Sequence[str]
    values: Sequence[Any]

    def changes(self, level: int) -> dict[str, Any]:
        """Return the changes of the scenario at a level."""
        return dict.fromkeys(self.paths, self.values[level])


def severity_grid(text: str, built: Built) -> SeverityGrid:
    """Parse a grid, such as ``noise``, ``noise=0..1 by 0.1`` or ``agents.robot.components.steer.with.speed=1,2``.

    Args:
        text: The name of a degradation or a path, with values in the syntax of ``--over`` of sweeps.
        built: The scenario.

    Raises:
        ScenarioError: There is no such degradation, the scenario has nothing that it changes, there are no values, or
            they are not in the order from mild to severe.
    """
    name, equals, values = text.partition("=")
    name = name.strip()
    kind = DEGRADATIONS.get(name)
    if kind is None:
        if not equals:
            raise _wrong(text, f"there is no degradation `{name}`", name)
        return SeverityGrid(name, [name], _values(text))
    places = dict(kind.places(built))
    if not places:
        raise _wrong(text, f"nothing can be degraded by `{name}`: {kind.lacking}")
    if equals:
        grid = _values(f"{next(iter(places))}={values}")
    elif kind.grid is not None:
        grid = _values(f"{next(iter(places))}={kind.grid}")
    else:
        grid = [float(f"{max(places.values()) * tenths / 10:.12g}") for tenths in range(10, 0, -1)]
    for mild, severe in pairwise(grid):
        if not isinstance(mild, int | float) or not isinstance(severe, int | float):
            raise _wrong(text, f"the values of `{name}` are numbers")
        if mild == severe or (mild < severe) != kind.is_ascending:
            order = "ascend" if kind.is_ascending else "descend"
            raise _wrong(text, f"levels go from mild to severe: the values of `{name}` {order}")
    return SeverityGrid(name, [*places], grid)


def _values(text: str) -> list[Any]:
    values = [each.value.plain() for each in alternatives(varied((text,))[0])]
    if len(values) > _MOST:
        raise _wrong(text, f"there are {len(values):,} levels; at most {_MOST:,} make sense")
    repeated = next((each for number, each in enumerate(values) if each in values[:number]), None)
    if repeated is not None:
        raise _wrong(text, f"the level {repeated} occurs twice")
    return values


def _wrong(text: str, message: str, unknown: str | None = None) -> ScenarioError:
    span = TextSpan(f"--over {text}", 1, 1, len(text) + 1)
    known = [*DEGRADATIONS]
    return ScenarioError(
        [
            Problem(
                "invalid-value",
                message,
                span,
                "",
                f"{', '.join(known)}, or PATH=VALUES" if unknown else None,
                nearest(unknown, known) if unknown else None,
                text,
            )
        ]
    )
