"""Tasks: requirements of the specifications of a scenario on one drone, or on one drone relative to another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from symaware_cli import nanoseconds
from symaware_cli.formulas import Call, Element, Junction, Name, Node, Region, Specification, Temporal, printed
from symaware_drones.polygon import Corner, negated

#: Agents by their names in formulas about pairs.
_SIDES = {"first": 0, "second": 1}


@dataclass(frozen=True, slots=True)
class Task:
    """A drone shall be in a polygon, around a point or around another drone, during an interval.

    Attributes:
        name: The specification that it is a part of.
        agents: The one drone, or two in the order of the roster; the position of the second minus that of the first
            shall be in the polygon.
        corners: The polygon, counter-clockwise [m].
        start: The earliest beginning of the interval [ns].
        latest: The latest beginning, which differs from `start` for `eventually` [ns].
        duration: The length of the interval [ns].
    """

    name: str
    agents: tuple[str, ...]
    corners: tuple[Corner, ...]
    start: int
    latest: int
    duration: int

    def __str__(self) -> str:
        return f"`{self.name}` of {' and '.join(self.agents)}"


def tasks_of(specification: Specification, order: Mapping[str, int]) -> Iterator[Task]:
    """Yield the tasks that a specification consists of.

    It is a conjunction of `always[a, b] p`, `eventually[a, b] p` and `eventually[a, b] always[c, d] p`, in which p is
    `inside(position, region)` with a polygon or a box, in the world or around another agent without turning with it.

    Args:
        specification: The specification.
        order: The index in the roster of each agent.

    Raises:
        ValueError: It is of another form; the message names that part.
    """
    if specification.automaton is not None:
        raise ValueError("tasks are formulas of signal temporal logic")
    scope = specification.scope
    for part in _conjuncts(specification.formulation.tree):
        start, latest, duration, predicate = _interval(part)
        for row in range(scope.rows):
            ids = scope.agents(row)
            subject = _subject(predicate, ids)
            region = _region(predicate, specification)
            if region.around == subject:
                raise ValueError(f"`{printed(predicate)}` asks where {subject} is relative to itself")
            agents: tuple[str, ...] = (subject,)
            corners = _corners(region)
            if region.around is not None:
                agents = (region.around, subject)
                if order[subject] < order[region.around]:
                    agents, corners = agents[::-1], negated(corners)
            begin = specification.start
            yield Task(specification.name, agents, tuple(corners), begin + start, begin + latest, duration)


def _conjuncts(node: Node) -> Iterator[Node]:
    if isinstance(node, Junction) and node.operator == "and":
        for operand in node.operands:
            yield from _conjuncts(operand)
    else:
        yield node


def _interval(node: Node) -> tuple[int, int, int, Call]:
    """Return the earliest and the latest beginning, the duration [ns], and the predicate."""
    match node:
        case Temporal(operator="always", window=(first, last), operands=(Call() as predicate,)):
            _check_bounded(node, last)
            start, end = nanoseconds(first), nanoseconds(last)
            return start, start, end - start, predicate
        case Temporal(operator="eventually", window=(first, last), operands=(Call() as predicate,)):
            _check_bounded(node, last)
            return nanoseconds(first), nanoseconds(last), 0, predicate
        case Temporal(
            operator="eventually",
            window=(first, last),
            operands=(Temporal(operator="always", window=(lead, hold), operands=(Call() as predicate,)),),
        ):
            _check_bounded(node, last, hold)
            begin = nanoseconds(first + lead), nanoseconds(last + lead)
            return *begin, nanoseconds(hold - lead), predicate
    raise ValueError(
        f"`{printed(node)}` is no task: always[a, b], eventually[a, b] or eventually[a, b] always[c, d] of "
        "inside(position, region)"
    )


def _check_bounded(node: Node, *ends: float) -> None:
    if any(end == float("inf") for end in ends):
        raise ValueError(f"`{printed(node)}` has no end")


def _subject(predicate: Call, ids: tuple[str, ...]) -> str:
    """Return the agent whose position is meant."""
    match predicate:
        case Call(function="inside", arguments=(Name(name="position"), Name())) if len(ids) == 1:
            return ids[0]
        case Call(function="inside", arguments=(Element(operand=Name(name="position"), key=str(key)), Name())) if (
            key in _SIDES and len(ids) == 2
        ):
            return ids[_SIDES[key]]
    raise ValueError(f"`{printed(predicate)}` is not inside(position, region) of an agent")


def _region(predicate: Call, specification: Specification) -> Region:
    name = predicate.arguments[1]
    assert isinstance(name, Name)
    found = specification.scope.regions.get(name.name)
    if found is None:
        raise ValueError(f"`{printed(predicate)}` does not name a region")
    region = found.region
    if region.polygon is None and (region.box is None or len(region.box) != 4):
        raise ValueError(f"the region `{name.name}` is no polygon and no box in the plane")
    if region.around is not None and region.turns:
        raise ValueError(f"the region `{name.name}` turns with {region.around}; set `turns: false`")
    return region


def _corners(region: Region) -> list[Corner]:
    if region.polygon is not None:
        return [(corner[0], corner[1]) for corner in region.polygon]
    assert region.box is not None
    west, east, south, north = region.box
    return [(west, south), (east, south), (east, north), (west, north)]
