"""Samples initial states and knowledge for the agents of a group: one for all, one for each, or from a distribution.

Draws are keyed by the seed of the run and the agent's path, so adding agents does not change the values of others.
"""

from __future__ import annotations

import copy
import difflib
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Model
from symaware_cli.geometry import LARGEST
from symaware_cli.language.compose import Composition
from symaware_cli.language.diagnosis import leaves_of
from symaware_cli.language.free_places import FREE, FreePlacement, PlacementError, Places, Unplaced
from symaware_cli.language.placement import REGULAR
from symaware_cli.language.problem import Problem, dotted, nearest, quoted
from symaware_cli.language.section import Section
from symaware_cli.language.source import Path
from symaware_cli.language.validation import a_number, said_of, validate
from symaware_cli.world import (
    FARTHEST,
    MODIFIERS,
    RANDOM,
    GroupChance,
    Seed,
    agent_numbers,
    is_within,
)

if TYPE_CHECKING:
    from symaware_cli.world import VectorDistribution

Array = NDArray[np.float64]


#: The placements of agents by the name that a scenario gives them.
PLACEMENTS: dict[str, type[Section]] = {**REGULAR, FREE: FreePlacement}

#: Distributions that differ from agent to agent: those that are drawn, and placements.
DISTRIBUTIONS = (*RANDOM, *PLACEMENTS)
FORMS = (*DISTRIBUTIONS, "each", "all")


class Sampler:
    """Determines the initial states and knowledge of the agents of one group.

    Attributes:
        problems: The problems found so far.
    """

    def __init__(
        self,
        composition: Composition,
        seed: Seed,
        ids: Sequence[str],
        indexed: bool,
        model: Model | type[Model] | None,
        places: Places | None = None,
    ) -> None:
        """Start without values.

        Args:
            composition: The scenario.
            seed: The seed of the run; of several runs, whose agents are sampled together, those of the first run first.
            ids: The ids of the agents of a run.
            indexed: Whether the scenario states the number of agents.
            model: Their model, if it is known.
            places: Places the agents in free space; None if nothing may be placed there.
        """
        self.problems: list[Problem] = []
        self._composition = composition
        self._seed = seed
        self._ids = ids
        self._indexed = indexed
        self._model = model
        self._places = places
        #: Whether coordinates are unknown yet, so that numbers cannot be checked.
        self._is_preliminary = isinstance(places, Unplaced) and places.coordinate != places.coordinate
        #: The number of values: one for each agent of each run.
        self._rows = len(ids) * (1 if isinstance(seed, int) else len(seed))
        self._numbers = np.tile(agent_numbers(ids), self._rows // max(1, len(ids)))
        # The parameters of each distribution, checked once for all agents; None after a problem.
        self._known: dict[Path, Any] = {}
        # The draws of all agents from each distribution that they share.
        self._drawn: dict[Path, Array] = {}
        self._is_each = False
        #: The paths of the values for all agents without one of their own; see `_own`.
        self._rests: set[Path] = set()

    def states(self, value: Any, path: Path) -> Array:
        """The initial state of each agent; shape (n, nx), or (n, 0) after a problem."""
        if self._model is None:
            return np.empty((self._rows, 0))
        width = len(self._model.state)
        if value is None:
            return np.zeros((self._rows, width))
        each = self._values(value, path, width)
        if each is None or not len(each):
            return np.empty((self._rows, 0))
        states = np.array(each, float)
        if self._is_preliminary:
            return states
        if not is_within(states, LARGEST):
            row, element = (int(place[0]) for place in np.nonzero(~(np.abs(states) <= LARGEST)))
            self._report_size(path, row, (element,), float(states[row, element]), LARGEST)
        return states

    def knowledge(self, value: Any, path: Path) -> list[Any]:
        """The knowledge of each agent under one name; empty after a problem."""
        each = self._values(value, path, None)
        if isinstance(each, np.ndarray):
            return list(each)
        if each is not None and self._is_preliminary:
            return list(each)
        table = None if each is None else _table(each)
        if table is not None and is_within(table, FARTHEST) and (table != table[0]).any():
            return list(table)
        for row, known in enumerate(each or ()):
            if (far := _first_excessive(known)) is not None:
                self._report_size(path, row, *far, FARTHEST)
                break
        if each and all(one is each[0] for one in each):
            # The group makes a copy for each agent.
            return [np.array(each[0], float) if _is_array(each[0]) else each[0]] * len(each)
        return [np.array(one, float) if _is_array(one) else one for one in each] if each else []

    def known(self, content: Mapping[str, Any], path: Path) -> list[dict[str, Any]]:
        """The whole knowledge of each agent, by name; invalid values are left out."""
        found: list[dict[str, Any]] = [{} for _ in range(self._rows)]
        for name, value in content.items():
            for own, one in zip(found, self.knowledge(value, (*path, name)), strict=False):
                own[name] = one
        return found

    def _report_size(self, path: Path, row: int, inner: Path, number: float, most: float) -> None:
        """Report a number that is too large, at its position if it was written and not drawn."""
        own = row % len(self._ids)
        forms: tuple[Path, ...] = (("each", own), (own,), ("all",), ())
        places = [(*path, *form, *inner) for form in forms]
        where = next((place for place in places if self._composition.has(place)), path)
        expected = f"a number from {-most:g} to {most:g}"
        self._report(
            "out-of-range", f"{quoted(dotted(where))} evaluates to {said_of(number)}", where, expected=expected
        )

    def _values(self, value: Any, path: Path, width: int | None) -> list[Any] | Array | None:
        """Determine the value of each agent; None after a problem."""
        count = len(self._ids)
        if isinstance(value, Mapping) and value.keys() == {"own", "rest"}:
            return self._own(value["own"], value["rest"], path, width)
        form = self._form(value, path, width)
        if form is None:
            return None
        self._is_each, content, inner = form
        if not self._is_each:
            if isinstance(content, Mapping) and len(content) == 1 and next(iter(content)) in PLACEMENTS:
                # Computed once for all agents.
                kind, placement = next(iter(content.items()))
                placed = self._placed(kind, placement, (*inner, kind), width, range(count))
                return None if placed is None else np.tile(placed, (self._rows // count, 1))
            first = self._collect(lambda row: self._value(content, inner, row, width), only=1)
            if first is None or not contains(content, DISTRIBUTIONS):
                return first and first * self._rows
            columns = self._columns(content, inner)
            return columns or self._collect(lambda row: self._value(content, inner, row, width))
        if not isinstance(content, list) or len(content) != count:
            said = f"{len(content)} values" if isinstance(content, list) else said_of(content)
            said = "1 value" if said == "1 values" else said
            agents = "1 agent" if count == 1 else f"{count} agents"
            shared = "" if width is not None else ", or {all: ...} for one value that all share"
            expected = f"a list of {count}{shared}"
            self._report("wrong-count", f"{quoted(dotted(path))} gives {said} for {agents}", inner, expected=expected)
            return None
        return self._collect(
            lambda row: self._value(content[row % count], (*inner, row % count), row, width), tolerance=10
        )

    def _own(self, own: Any, rest: Any, path: Path, width: int | None) -> list[Any] | None:
        """Determine the value of each agent if some agents have values of their own; None after a problem.

        Args:
            own: Values by the numbers of their agents, as text.
            rest: The value of all other agents, in any form; their random draws do not depend on `own`.
            path: The path of both.
            width: See `_filled`.
        """
        count = len(self._ids)
        self._rests.add((*path, "rest"))
        others: list[Any] | Array | None = [[0.0] * (width or 0)] * self._rows
        if rest is not None:
            others = self._values(rest, (*path, "rest"), width)
        elif width is None:
            others = [None] * self._rows
        if others is None or not isinstance(own, Mapping):
            return None
        found = list(others)
        before = len(self.problems)
        self._is_each = False
        for number, value in own.items():
            if not number.isascii() or not number.isdecimal() or int(number) >= count:
                message = f"there is no agent {number}"
                self._report("wrong-count", message, (*path, "own", number), key=True, expected=f"0 to {count - 1}")
                continue
            for row in range(int(number), self._rows, count):
                found[row] = self._value(value, (*path, "own", number), row, width)
        return found if len(self.problems) == before else None

    def _form(self, value: Any, path: Path, width: int | None) -> tuple[bool, Any, Path] | None:
        """Return whether a value lists one value per agent, its content and the path of that; None after a problem."""
        if isinstance(value, Mapping):
            if len(value) == 1 and next(iter(value)) in ("each", "all"):
                form = next(iter(value))
                return form == "each", value[form], (*path, form)
            return None if self._is_misshapen(value, path, FORMS, width) else (False, value, path)
        nested = isinstance(value, list) and any(isinstance(one, list) for one in value)
        return nested and (self._indexed or width is not None), value, path

    def _is_misshapen(self, value: Mapping[str, Any], path: Path, forms: Sequence[str], width: int | None) -> bool:
        """Report a mapping that is an invalid distribution; in knowledge, other mappings are ordinary values."""
        known = [name for name in value if name in forms]
        beside_it = MODIFIERS if known and known[0] in RANDOM else ()
        others = [name for name in value if name not in (*forms, *beside_it)]
        if len(known) == 1 and not others:
            return False
        expected = f"exactly one of {', '.join(forms)}"
        if known:
            beside = f"{quoted((others or known[1:])[0])} cannot be combined with {quoted(known[0])}"
            culprit = (*path, (others or known[1:])[0])
            self._report("bad-distribution", beside, culprit, key=True, expected=expected)
            return True
        suggestion = nearest(others[0], forms) if len(others) == 1 else None
        if width is None and not (suggestion and _is_misspelled(others[0], suggestion)):
            return False
        if not others:
            message = f"{quoted(dotted(path))} is an empty mapping"
            self._report("bad-distribution", message, path, expected=expected)
            return True
        if width is None:
            expected += ", or {all: {...}} for a value that has such a key"
        model = self._model
        if suggestion is None and model is not None and set(others) & {quantity.name for quantity in model.state}:
            message = f"{quoted(dotted(path))} is a mapping"
            self._report("wrong-type", message, path, expected=f"a list of {self._elements(model)}")
            return True
        message = (
            f"{quoted(others[0])} gives a whole state, not one element"
            if others[0] in FORMS
            else f"unknown distribution {quoted(others[0])}"
        )
        culprit = (*path, others[0])
        self._report("bad-distribution", message, culprit, key=True, expected=expected, suggestion=suggestion)
        return True

    def _collect(self, value_of: Callable[[int], Any], tolerance: int = 0, only: int | None = None) -> list[Any] | None:
        """Collect the values of all agents, or of the first ones; stop after more than `tolerance` problems."""
        before = len(self.problems)
        values = []
        for row in range(self._rows if only is None else only):
            values.append(value_of(row))
            if len(self.problems) > before + tolerance:
                break
        return values if len(self.problems) == before else None

    def _value(self, value: Any, path: Path, row: int, width: int | None) -> Any:
        """The value of one agent; after a problem, the result is meaningless."""
        before = len(self.problems)
        drawn = self._filled(value, path, row, width)
        if width is None or len(self.problems) > before:
            return drawn
        return self._state(drawn, path)

    def _filled(self, value: Any, path: Path, row: int, width: int | None) -> Any:
        """Return a copy of a value with every distribution in it replaced by an agent's draw.

        Args:
            value: The value in the scenario.
            path: Its path.
            row: The agent's row.
            width: The number of elements of a state; 0 for a single element, None for knowledge.
        """
        if isinstance(value, list):
            inner = None if width is None else 0
            return [self._filled(one, (*path, number), row, inner) for number, one in enumerate(value)]
        if not isinstance(value, Mapping):
            return value
        if path[-1] == "all" and width is None and not any(name in DISTRIBUTIONS for name in value):
            return copy.deepcopy(value)
        # One element of a state is a number, whereas grid and circle give positions.
        forms = RANDOM if width == 0 else DISTRIBUTIONS
        if self._is_misshapen(value, path, forms, width):
            return None
        kind = _kind_of(value, forms)
        if kind is None:
            return copy.deepcopy(value)
        if kind in RANDOM:
            return self._random(value, kind, path, row, width)
        own = row % len(self._ids)
        placed = self._placed(kind, value[kind], (*path, kind), width, range(own, own + 1))
        return None if placed is None else placed[0].tolist()

    def _state(self, value: Any, path: Path) -> Any:
        model = self._model
        assert model is not None
        expected = self._elements(model)
        if not isinstance(value, list):
            self._report("wrong-type", f"the state is {said_of(value)}", path, expected=f"a list of {expected}")
            return None
        for number, one in enumerate(value):
            if not _is_number(one):
                name = f" ({model.state[number].name})" if number < len(model.state) else ""
                self._report(
                    "wrong-type",
                    f"element {number}{name} of the state is {said_of(one)}",
                    (*path, number),
                    expected=a_number(one),
                )
                return None
        if len(value) != len(model.state):
            elements = "1 element" if len(value) == 1 else f"{len(value)} elements"
            self._report("wrong-length", f"the state has {elements}", path, expected=expected)
            return None
        return value

    def _elements(self, model: Model | type[Model]) -> str:
        names = ", ".join(f"{quantity.name} [{quantity.unit}]" for quantity in model.state)
        return f"{len(model.state)} numbers: {names}"

    def _random(self, value: Mapping[str, Any], kind: str, path: Path, row: int, width: int | None) -> Any:
        if path not in self._known:
            self._known[path] = self._distribution(value, kind, path)
        distribution = self._known[path]
        if distribution is None:
            return None
        if distribution.choice is not None:
            chosen = distribution.values(self._units(distribution, (*path, kind), row, 1))[0]
            return copy.deepcopy(chosen)
        # A single number for a whole state applies to every element.
        count = distribution.elements or width or 0
        drawn = _of_units(distribution, self._units(distribution, (*path, kind), row, count or 1))
        return drawn.tolist() if count else float(drawn[0])

    def _columns(self, value: Any, path: Path) -> list[Any] | None:
        """Draw the values of all agents element by element, instead of agent by agent.

        The value must be valid for the first agent. None unless it is a list of numbers and distributions of single
        numbers.
        """
        if not isinstance(value, list):
            return None
        columns = np.empty((self._rows, len(value)))
        for number, one in enumerate(value):
            if _is_number(one) and abs(one) <= FARTHEST:
                columns[:, number] = one
                continue
            distribution = self._known.get((*path, number))
            if distribution is None or distribution.choice or distribution.elements:
                return None
            unit = self._shared_units(distribution, (*path, number, distribution.form), 1)
            columns[:, number] = _of_units(distribution, unit)[:, 0]
        return columns.tolist()

    def _units(self, distribution: VectorDistribution, path: Path, row: int, count: int) -> Array:
        """An agent's draws that a distribution is made of; shape (count,)."""
        drawn = self._shared_units(distribution, path, count, row % len(self._ids) if self._is_each else None)
        own: Array = drawn[row // len(self._ids) if self._is_each else row]
        return own

    def _shared_units(
        self, distribution: VectorDistribution, path: Path, count: int, agent: int | None = None
    ) -> Array:
        """The draws of all rows, or of one agent of each run to which a distribution belongs; shape (m, count)."""
        if path not in self._drawn:
            numbers = self._numbers if agent is None else self._numbers[agent :: len(self._ids)]
            chance = GroupChance(self._seed, self._purpose(path), numbers)
            draw = chance.standard_normal if distribution.is_plain_normal else chance.uniform
            self._drawn[path] = draw(count)
        return self._drawn[path]

    def _purpose(self, path: Path) -> str:
        """The purpose of the draws of a distribution."""
        parts = (str(part) for place, part in enumerate(path) if place > 1 and path[: place + 1] not in self._rests)
        return f"scenario {'.'.join(parts)}"

    def _distribution(self, value: Mapping[str, Any], kind: str, path: Path) -> VectorDistribution | None:
        """Check a distribution; None after a problem."""
        from symaware_cli.world import VectorDistribution

        found = validate(VectorDistribution, value, self._composition, path)
        if isinstance(found, list):
            self.problems += [problem for problem in found if problem not in self.problems]
            return None
        if found.largest > LARGEST:
            inner = (*path, kind)
            self._report("out-of-range", "the distribution is too wide", inner, expected=f"at most {LARGEST:g}")
            return None
        return found

    def _placed(self, kind: str, content: Any, path: Path, width: int | None, rows: range) -> Array | None:
        """The values of some agents in a placement: states with zeros elsewhere, or positions; None after a problem."""
        if path not in self._known:
            found: Any = validate(PLACEMENTS[kind], content, self._composition, path)
            if isinstance(found, list):
                self.problems += found
                found = None
            elif kind != FREE:
                # Computed once for all agents.
                positions, headings = found.poses(len(self._ids))
                found = self._in_states(positions, headings, width)
            self._known[path] = found
        known = self._known[path]
        if isinstance(known, FreePlacement):
            return self._placed_freely(known, path, width, rows)
        placed: Array | None = None if known is None else known[rows.start : rows.stop]
        return placed

    def _placed_freely(self, placement: FreePlacement, path: Path, width: int | None, rows: range) -> Array | None:
        """The values of some agents that are placed in free space, each only once; None after a problem."""
        if self._places is None:
            message = "agents are placed in free space only when a run begins"
            self._report("bad-distribution", message, path, key=True, expected="a position, or another distribution")
            return None
        use = path[: 3 if path[2] == "state" else 4]
        try:
            poses = self._places.poses(placement, use, self._purpose(path), rows)
        except PlacementError as error:
            self._report("unsuitable", f"the agents cannot be placed: {error}", path, key=True)
            self._known[path] = None
            return None
        return self._in_states(*poses, width)

    def _in_states(self, positions: Array, headings: Array, width: int | None) -> Array:
        model = self._model
        if width is None or model is None:
            return positions
        states = np.zeros((len(positions), width))
        for index, coordinates in zip(model.position, positions.T, strict=False):
            states[:, index] = coordinates
        if model.heading is not None:
            states[:, model.heading] = headings
        return states

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


def _is_misspelled(written: str, meant: str) -> bool:
    """Whether a key is so similar to the name of a form that it is probably a misspelling."""
    if written[:1].lower() != meant[:1]:
        return False
    return sorted(written) == sorted(meant) or difflib.SequenceMatcher(None, written, meant).ratio() > 0.8


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def contains(value: Any, forms: Sequence[str]) -> bool:
    """Whether a value may contain a distribution of one of these forms."""
    if isinstance(value, Mapping):
        return any(name in forms or contains(each, forms) for name, each in value.items())
    return isinstance(value, list) and any(contains(each, forms) for each in value)


def _first_excessive(known: Any) -> tuple[Path, float] | None:
    """Return the first float in a value that is too large, with its path; integers fit in 64 bits anyway."""
    leaves = leaves_of(known)
    return next(
        ((inner, value) for inner, value in leaves if isinstance(value, float) and not abs(value) <= FARTHEST), None
    )


def _table(values: Sequence[Any]) -> Array | None:
    """Return lists of floats that are equally long as an array, which is faster than one by one; None for others."""
    if not all(type(one) is list for one in values) or len({len(one) for one in values}) != 1:
        return None
    if {type(number) for one in values for number in one} != {float}:
        return None
    return np.array(values)


def _is_array(value: Any) -> bool:
    """Whether a value is a list of numbers, or of lists of equal shapes."""
    return isinstance(value, list) and _shape(value) is not None


def _shape(value: Any) -> tuple[int, ...] | None:
    """The shape of nested lists of numbers; None if they are ragged, empty or contain other values."""
    if not isinstance(value, list):
        return () if _is_number(value) else None
    shapes = {_shape(one) for one in value}
    if len(shapes) != 1 or None in shapes:
        return None
    return (len(value), *next(shape for shape in shapes if shape is not None))


def _kind_of(value: Mapping[str, Any], forms: Sequence[str]) -> str | None:
    """Return the form of a distribution; None if the mapping is not a distribution."""
    return next((name for name in value if name in forms), None)


def _of_units(distribution: VectorDistribution, units: Array) -> Array:
    """Transform samples to a distribution: standard normal ones for a plain normal distribution, else uniform ones."""
    return distribution.scaled(units) if distribution.is_plain_normal else distribution.quantiles(units)
