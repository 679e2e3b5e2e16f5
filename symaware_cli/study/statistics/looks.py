"""At which numbers of runs a stopping rule is evaluated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Looks:
    """A schedule of looks, declared before the first run.

    After a look at n runs, the next is at max(n + step, ceil(ratio n)) runs, and the first at `step`: a ratio of 1
    gives a look every `step` runs, a greater one a geometric schedule, with few looks for many runs.

    Attributes:
        step: The least number of runs between two looks, and before the first.
        ratio: The least ratio of the numbers of runs of two looks, at least 1.
    """

    step: int = 20
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"there is at least 1 run between two looks, not {self.step}")
        if not (math.isfinite(self.ratio) and self.ratio >= 1.0):
            raise ValueError(f"the ratio of a geometric schedule is at least 1, not {self.ratio:g}")

    def after(self, count: int) -> int:
        """Return the number of runs of the look after one at this number of runs; 0 gives the first look."""
        return max(count + self.step, math.ceil(self.ratio * count))

    def __iter__(self) -> Iterator[int]:
        count = 0
        while True:
            count = self.after(count)
            yield count
