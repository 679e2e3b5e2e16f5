"""Schedules: when the barrier of each task is in force, and how wide it is at first; and which tasks cannot be met."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from symaware_drones.polygon import Corners, faces, intersection, minkowski_sum, negated, support
from symaware_drones.task import Task

Beginning: TypeAlias = Literal["earliest", "middle", "latest"]
Activation: TypeAlias = Literal["sequence", "start"]

_SECOND = 1e9


@dataclass(frozen=True, slots=True)
class ScheduledTask:
    """A task with its times, and the faces of its polygon.

    Attributes:
        task: The task.
        activation: When its barrier comes into force, t0 [ns].
        start: When the drone is to be in the polygon, t_s [ns].
        end: The end of this interval, t_e [ns].
        faces: For each face the outward normal (two elements), the offset and the width at activation g0 [m].
    """

    task: Task
    activation: int
    start: int
    end: int
    faces: tuple[tuple[float, float, float, float], ...]

    def width(self, now: int) -> list[float]:
        """Return g(t) of each face [m]."""
        if now >= self.start:
            return [0.0] * len(self.faces)
        share = min(1.0, (self.start - now) / (self.start - self.activation))
        return [share * face[3] for face in self.faces]


class Schedule:
    """The tasks of each drone and of each pair of drones, in the order of their times.

    Attributes:
        tasks: The tasks of each drone (one id) and each pair (two ids, in the order of the roster).
    """

    def __init__(
        self,
        tasks: Iterable[Task],
        positions: Mapping[str, tuple[float, float]],
        *,
        activation: Activation = "sequence",
        beginning: Beginning = "latest",
        clearance: float = 0.1,
        shrinkage: float = 0.0,
    ) -> None:
        """Determine the times and widths.

        Args:
            tasks: All tasks.
            positions: The initial position of each agent [m].
            activation: When barriers come into force: each as the last task before it ends, or all at the start.
            beginning: The beginning of tasks that may begin within an interval.
            clearance: The least value of a barrier at its activation [m], as long as the task before it holds; if all
                come into force at the start, as long as the drone is at its position or where an earlier task requires
                it.
            shrinkage: The distance by which all faces are moved inwards [m].
        """
        by_agents: dict[tuple[str, ...], list[tuple[int, int, Task]]] = {}
        for task in tasks:
            start = {"earliest": task.start, "middle": (task.start + task.latest) // 2, "latest": task.latest}[
                beginning
            ]
            by_agents.setdefault(task.agents, []).append((start, start + task.duration, task))
        self.tasks: dict[tuple[str, ...], tuple[ScheduledTask, ...]] = {}
        for agents, timed in by_agents.items():
            timed.sort(key=lambda each: each[:2])
            initial = positions[agents[-1]]
            if len(agents) == 2:
                initial = initial[0] - positions[agents[0]][0], initial[1] - positions[agents[0]][1]
            found = []
            for start, end, task in timed:
                before = [each for each in timed if each[1] <= start and each[2] is not task]
                known: Corners = [initial]
                at = 0
                if activation == "start":
                    known = [initial, *(corner for each in before for corner in each[2].corners)]
                elif before:
                    last = max(before, key=lambda each: each[1])
                    known, at = last[2].corners, last[1]
                wide = tuple(
                    (x, y, offset - shrinkage, _width(support(known, x, y) - offset + shrinkage, clearance, at < start))
                    for x, y, offset in faces(task.corners)
                )
                found.append(ScheduledTask(task, at, start, end, wide))
            self.tasks[agents] = tuple(found)

    def check(self, speed: float) -> None:
        """Check that each task can be met by a drone of a speed, and all of them together.

        Raises:
            ValueError: One cannot; the message names it, and those that it contradicts.
        """
        for task in sorted((each for every in self.tasks.values() for each in every), key=lambda each: each.start):
            widest, time = max(face[3] for face in task.faces), (task.start - task.activation) / _SECOND
            if widest >= speed * time and widest > 0.0:
                raise ValueError(
                    f"{task.task} cannot be met: its barrier is {widest:.3g} m wide at "
                    f"{task.activation / _SECOND:g} s, and {speed:g} m/s are too slow for the "
                    f"{time:.3g} s that are left"
                )
        for instant in sorted({task.start for every in self.tasks.values() for task in every}):
            self._check_together(instant)

    def _check_together(self, instant: int) -> None:
        """Check that there are positions with which all tasks of an instant hold.

        From the leaves of the task graph to its roots, the set of positions of a drone with which its own tasks and all
        those beyond it can hold is a polygon.
        """
        due = {
            agents: [task.task for task in every if task.start <= instant <= task.end]
            for agents, every in self.tasks.items()
        }
        allowed: dict[tuple[str, ...], tuple[list[tuple[float, float]], list[Task]]] = {}
        for agents, tasks in due.items():
            if tasks:
                corners = list(tasks[0].corners)
                for task in tasks[1:]:
                    corners = intersection(corners, task.corners) if corners else []
                _check_some(corners, tasks, instant)
                allowed[agents] = corners, tasks
        where = {agents[0]: each for agents, each in allowed.items() if len(agents) == 1}
        edges = {agents: each for agents, each in allowed.items() if len(agents) == 2}
        while edges:
            degrees: dict[str, int] = {}
            for one, other in edges:
                degrees[one], degrees[other] = degrees.get(one, 0) + 1, degrees.get(other, 0) + 1
            leaves = [(pair, id) for pair in edges for id in pair if degrees[id] == 1]
            if not leaves:
                return  # a cycle, which is refused elsewhere
            (one, other), leaf = leaves[0]
            corners, tasks = edges.pop((one, other))
            if leaf not in where:
                continue
            inner = one if leaf == other else other
            offsets = negated(corners) if leaf == other else corners
            sums, of_both = minkowski_sum(where[leaf][0], offsets), [*where[leaf][1], *tasks]
            if inner in where:
                sums, of_both = intersection(sums, where[inner][0]), [*of_both, *where[inner][1]]
                _check_some(sums, of_both, instant)
            where[inner] = sums, of_both


def task_graph(tasks: Iterable[Task], order: Mapping[str, int]) -> dict[str, list[str]]:
    """Return the neighbours of each agent that has a task, in the order of the roster.

    Raises:
        ValueError: The graph has a cycle; the message names a task on it.
    """
    graph: dict[str, list[str]] = {}
    parts: dict[str, str] = {}

    def part(id: str) -> str:
        while parts.setdefault(id, id) != id:
            id = parts[id]
        return id

    for task in tasks:
        for id in task.agents:
            graph.setdefault(id, [])
        if len(task.agents) == 1 or task.agents[1] in graph[task.agents[0]]:
            continue
        one, other = task.agents
        if part(one) == part(other):
            raise ValueError(
                f"{task} closes a cycle of tasks between drones: {' - '.join([*_path(graph, one, other), one])}"
            )
        parts[part(one)] = part(other)
        graph[one].append(other)
        graph[other].append(one)
    return {id: sorted(graph[id], key=order.__getitem__) for id in sorted(graph, key=order.__getitem__)}


def check_links(tasks: Iterable[Task], linked: Mapping[str, Sequence[str]]) -> None:
    """Check that the two drones of each task reach each other.

    Args:
        tasks: The tasks.
        linked: The agents that each agent reaches.

    Raises:
        ValueError: They do not; the message names the task.
    """
    for task in tasks:
        if len(task.agents) == 2:
            one, other = task.agents
            for sender, receiver in ((one, other), (other, one)):
                if receiver not in linked[sender]:
                    raise ValueError(f"{task} needs messages from {sender} to {receiver}, and there is no link")


def _path(graph: Mapping[str, Sequence[str]], one: str, other: str) -> list[str]:
    """Return the agents on the way from one to another."""
    waiting = [[one]]
    while waiting:
        path = waiting.pop()
        if path[-1] == other:
            return path
        waiting += [[*path, each] for each in graph[path[-1]] if each not in path]
    return [one, other]


def _width(missing: float, clearance: float, has_time: bool) -> float:
    return max(missing + clearance, clearance) if has_time else max(missing, 0.0)


def _check_some(corners: Corners, tasks: Sequence[Task], instant: int) -> None:
    if not corners:
        named = ", ".join(dict.fromkeys(map(str, tasks)))
        raise ValueError(f"tasks cannot be met together at {instant / _SECOND:g} s: {named}")
