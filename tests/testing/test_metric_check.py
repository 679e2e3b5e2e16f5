"""Metrics that break a rule are named, with the method and a correction."""

from itertools import count
from time import time
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations

import symaware_cli
from symaware_cli import Metric
from symaware_cli.testing import check_metric


class Path(Metric):
    """A valid metric: the distance travelled by all agents."""

    unit: ClassVar = "m"

    def begin(self) -> None:
        self.total, self.last = 0.0, self._positions()

    def look(self, now: int) -> None:
        here = self._positions()
        self.total += float(np.linalg.norm(here - self.last, axis=1).sum())
        self.last = here

    def value(self) -> Any:
        return self.total

    def _positions(self) -> Any:
        return self.environment.snapshot().positions


class Text(Path):
    """Returns a text in place of a number."""

    def value(self) -> Any:
        return "far"


class Truth(Path):
    """Returns a truth value in place of a number."""

    def value(self) -> Any:
        return True


class Endless(Path):
    """Returns infinity."""

    def value(self) -> Any:
        return np.inf


class Backwards(Path):
    """Returns a series whose times do not ascend."""

    kind: ClassVar[Any] = "series"

    def value(self) -> Any:
        return [(1.0, 0.0), (0.5, 1.0)]


class Lone(Path):
    """Returns a number in place of a series."""

    kind: ClassVar[Any] = "series"


class Odd(Path):
    """Has an unknown kind."""

    kind: ClassVar[Any] = "vector"


class Unitless(Path):
    """Has no text as its unit."""

    unit: ClassVar[Any] = None


class Versioned(Path):
    """Has no number as its version."""

    version: ClassVar[Any] = "1.0"


class Steering(Path):
    """Stops the agents."""

    def look(self, now: int) -> None:
        super().look(now)
        for group in self.groups:
            group.control_input = np.zeros_like(group.control_input)


class Emptying(Path):
    """Resets itself when its value is read."""

    def value(self) -> Any:
        total, self.total = self.total, 0.0
        return total


class Timed(Path):
    """Measures wall time."""

    def begin(self) -> None:
        super().begin()
        self.begun = time()

    def value(self) -> Any:
        return 0.0


NUMBERS = count()


class Counting(Path):
    """Counts the runs of the process."""

    def begin(self) -> None:
        super().begin()
        self.number = next(NUMBERS)

    def value(self) -> Any:
        return self.number


class Failing(Path):
    """Branches on an array."""

    def look(self, now: int) -> None:
        if self._positions() > 0:
            self.total += 1.0


class Listening(Path):
    """Fails at an event."""

    def begin(self) -> None:
        super().begin()
        self.subscribe("stepping", self._note)

    def _note(self, event: Any) -> None:
        raise LookupError("nothing to note")


BROKEN: dict[type[Metric], tuple[str, ...]] = {
    Text: ("Text.value (", "does not return a number", "return what `kind` declares"),
    Truth: ("Truth.value (", "does not return a number"),
    Endless: ("Endless.value (", "is not finite", "None where there is no value"),
    Backwards: ("Backwards.value (", "times that do not ascend"),
    Lone: ("Lone.value (", "returns a float", "a sequence of (time [s], number)"),
    Odd: ("Odd.kind (", "is 'vector'", "one of number, integer, truth, text, series"),
    Unitless: ("Unitless.unit (", "is None"),
    Versioned: ("Versioned.version (", "is '1.0'"),
    Steering: ("Steering.look (", "changes the run", "only read the world"),
    Emptying: ("Emptying.value (", "and 0.0 at once afterwards"),
    Timed: ("Timed.begin (", "reads the wall clock (`time.time`)"),
    Counting: ("Counting.value (", "in a second run", "depend on the run only"),
    Failing: ("Failing.look (", "branches on an array", "np.where"),
    Listening: ("Listening.subscribe", "lets the run fail", "nothing to note"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_metric_is_named_with_the_method_and_a_correction(kind: type[Metric]) -> None:
    said = deviations(check_metric, kind)
    for words in BROKEN[kind]:
        assert words in said


class Share(Path):
    """The share of a distance."""

    class Parameters(symaware_cli.Parameters):
        """Has a parameter without a description."""

        whole: float = 1.0


def test_a_metric_that_only_reads_conforms() -> None:
    check_metric(Path, {"agents.robot.count": 2})
    assert "does not describe `whole`" in deviations(check_metric, Share, whole=2.0)
