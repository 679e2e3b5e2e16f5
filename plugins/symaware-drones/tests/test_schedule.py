"""Schedules know when barriers are in force, and which tasks cannot be met."""

import re

import pytest
from symaware_drones.polygon import Corner, regular
from symaware_drones.schedule import Schedule, check_links, task_graph
from symaware_drones.task import Task

SECOND = 1_000_000_000
ORDER = {id: number for number, id in enumerate("abcd")}
PLACES = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (0.0, 1.0), "d": (2.0, 0.0)}


def around(x: float, y: float, radius: float = 0.5) -> tuple[Corner, ...]:
    return tuple((x + dx, y + dy) for dx, dy in regular(8, radius))


def task(name: str, agents: str, where: tuple[float, float], start: float, end: float, latest: float = 0.0) -> Task:
    begin = round(start * SECOND)
    later = round(max(latest, start) * SECOND)
    return Task(name, tuple(agents), around(*where), begin, later, round(end * SECOND) - begin)


def test_a_barrier_begins_as_the_previous_task_ends_and_is_positive_where_that_holds() -> None:
    first, second = Schedule([task("two", "a", (3, 0), 5, 6), task("one", "a", (0, 0), 1, 2)], PLACES).tasks[("a",)]
    assert (first.task.name, first.activation, second.activation) == ("one", 0, 2 * SECOND)
    for corner in first.task.corners:
        values = [offset - x * corner[0] - y * corner[1] + wide for x, y, offset, wide in second.faces]
        assert min(values) >= 0.1 - 1e-12
    assert second.width(second.start) == [0.0] * 8
    assert second.width(2 * SECOND) == [face[3] for face in second.faces]


def test_all_barriers_can_be_in_force_at_the_start() -> None:
    schedule = Schedule([task("one", "a", (0, 0), 1, 2), task("two", "a", (3, 0), 5, 6)], PLACES, activation="start")
    assert [each.activation for each in schedule.tasks[("a",)]] == [0, 0]


@pytest.mark.parametrize(("beginning", "start"), [("earliest", 3), ("middle", 4), ("latest", 5)])
def test_an_eventual_task_begins_within_its_interval(beginning: str, start: int) -> None:
    eventually = task("one", "ab", (1, 0), 3, 4, latest=5)
    (found,) = Schedule([eventually], PLACES, beginning=beginning).tasks[("a", "b")]  # type: ignore[arg-type]
    assert (found.start, found.end) == (start * SECOND, (start + 1) * SECOND)


@pytest.mark.parametrize(
    ("tasks", "said"),
    [
        ([task("far", "a", (9, 0), 2, 3)], "`far` of a cannot be met: its barrier is 7.95 m wide at 0 s"),
        ([task("now", "ab", (3, 0), 0, 1)], "`now` of a and b cannot be met"),
        ([task("one", "a", (0, 0), 1, 3), task("two", "a", (2, 0), 2, 4)], "at 2 s: `one` of a, `two` of a"),
        (
            [task("one", "a", (0, 0), 1, 3), task("two", "b", (4, 0), 2, 4), task("both", "ab", (2, 0), 2, 4)],
            "at 2 s: `one` of a, `both` of a and b, `two` of b",
        ),
    ],
)
def test_tasks_that_cannot_be_met_are_named(tasks: list[Task], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        Schedule(tasks, PLACES).check(3.0)


def test_tasks_that_can_be_met_along_a_chain_are_not_refused() -> None:
    chain = [task("ab", "ab", (1, 0), 3, 4), task("bc", "bc", (1, 0), 3, 4), task("a", "a", (0, 0), 3, 4)]
    Schedule([*chain, task("c", "c", (2.9, 0), 3, 4)], PLACES).check(3.0)
    with pytest.raises(ValueError, match="cannot be met together"):
        Schedule([*chain, task("c", "c", (4.5, 0), 3, 4)], PLACES).check(3.0)


def test_a_graph_with_a_cycle_is_refused_by_its_agents() -> None:
    chain = [task("ab", "ab", (1, 0), 3, 4), task("bc", "bc", (1, 0), 3, 4)]
    assert task_graph([*chain, task("again", "ab", (1, 0), 5, 6)], ORDER) == {"a": ["b"], "b": ["a", "c"], "c": ["b"]}
    with pytest.raises(ValueError, match="`ac` of a and c closes a cycle of tasks between drones: a - b - c - a"):
        task_graph([*chain, task("ac", "ac", (1, 0), 3, 4)], ORDER)


def test_a_task_between_drones_without_a_link_is_refused() -> None:
    linked = {"a": ["b"], "b": []}
    with pytest.raises(ValueError, match="`ab` of a and b needs messages from b to a, and there is no link"):
        check_links([task("ab", "ab", (1, 0), 3, 4)], linked)
