"""Barrier functions: the smooth minimum over the faces of the polygons of tasks that are in force."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from symaware_drones.schedule import ScheduledTask

_SECOND = 1e9


class BarrierSample(NamedTuple):
    """A barrier function at an instant.

    Attributes:
        value: b [m].
        x: First element of its gradient with respect to the (relative) position.
        y: Second element of it.
        rate: Its partial derivative with respect to time [m/s].
    """

    value: float
    x: float
    y: float
    rate: float


class Barrier:
    """The barrier of the tasks of one drone, or of a pair.

    For each face, b = d - a.e + g(t), where a is its normal, d its offset and e the position of the drone (relative to
    the other of a pair). g falls linearly from g0 at the activation of the task to 0 at its start; after its end the
    face is dropped. All faces together have the barrier -(1 / eta) ln(sum exp(-eta b)), which is at most ln(n) / eta
    less than the minimum of n faces (L. Lindemann, D. V. Dimarogonas, "Control Barrier Functions for Signal Temporal
    Logic Tasks", IEEE Control Systems Letters 3, 2019).

    Attributes:
        tasks: The tasks.
    """

    def __init__(self, tasks: Sequence[ScheduledTask], eta: float) -> None:
        self.tasks = tuple(tasks)
        self._eta = eta
        #: When the tasks in force change [ns], and which are in force from each of these instants on.
        self._changes = sorted({task.activation for task in tasks} | {task.end + 1 for task in tasks})
        self._in_force = [[task for task in tasks if task.activation <= change <= task.end] for change in self._changes]
        self._tables = [_table(tasks) for tasks in self._in_force]

    def in_force(self, now: int) -> Sequence[ScheduledTask]:
        """Return the tasks whose barriers are in force at an instant [ns]."""
        place = bisect_right(self._changes, now) - 1
        return self._in_force[place] if place >= 0 else ()

    def sample(self, now: int, x: float, y: float) -> BarrierSample | None:
        """Evaluate the barrier; None while none is in force.

        Args:
            now: The instant [ns].
            x: Position along the first axis [m].
            y: Position along the second axis [m].
        """
        place = bisect_right(self._changes, now) - 1
        if place < 0 or not self._in_force[place]:
            return None
        return self._smooth(self._tables[place], now, x, y)

    def values(self, now: int, x: float, y: float) -> dict[str, float]:
        """Return the barrier of each task in force by itself, by the name of its specification [m]."""
        found: dict[str, float] = {}
        for task in self.in_force(now):
            value = self._smooth(_table([task]), now, x, y).value
            found[task.task.name] = min(value, found.get(task.task.name, value))
        return found

    def _smooth(self, table: Sequence[tuple[float, ...]], now: int, x: float, y: float) -> BarrierSample:
        # With a few faces, plain numbers take a fraction of the time that arrays do.
        faces, time, eta = [], now / _SECOND, self._eta
        for normal_x, normal_y, offset, wide, start, slope in table:
            left = start - time
            value = offset - normal_x * x - normal_y * y
            if left > 0.0:
                faces.append((value + (wide if slope * left > wide else slope * left), normal_x, normal_y, -slope))
            else:
                faces.append((value, normal_x, normal_y, 0.0))
        least = min(face[0] for face in faces)
        total = gradient_x = gradient_y = rate = 0.0
        for value, normal_x, normal_y, slope in faces:
            weight = math.exp(eta * (least - value))
            total += weight
            gradient_x -= weight * normal_x
            gradient_y -= weight * normal_y
            rate += weight * slope
        return BarrierSample(least - math.log(total) / eta, gradient_x / total, gradient_y / total, rate / total)


def _table(tasks: Sequence[ScheduledTask]) -> list[tuple[float, ...]]:
    """Return normal, offset, width, start [s] and slope [m/s] of each face."""
    return [
        (x, y, offset, wide, task.start / _SECOND, _slope(task, wide))
        for task in tasks
        for x, y, offset, wide in task.faces
    ]


def _slope(task: ScheduledTask, wide: float) -> float:
    return wide / ((task.start - task.activation) / _SECOND) if task.start > task.activation else 0.0
