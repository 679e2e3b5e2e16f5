"""Kinds of faults that break a rule are named, with the method and a correction."""

import time
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations

import symaware_cli
from symaware_cli import AgentPattern, AgentSelection, Fault, FaultContext, FaultTargets
from symaware_cli.testing import check_fault


class Halt(Fault):
    """A valid fault that stops agents for a while."""

    class Parameters(symaware_cli.Parameters):
        """Which agents."""

        of: AgentPattern = "robot.0"

    agents: list[AgentSelection]

    @property
    def source(self) -> str:
        return f"agents.{self.parameters.of}"

    @property
    def text(self) -> str:
        return f"halts {self.parameters.of}"

    def resolve(self, context: FaultContext) -> None:
        self.agents = context.agents(self.parameters.of, "of")

    def begin(self, run: FaultTargets) -> Any:
        for each in self.agents:
            run.stop(each, self.name)

    def end(self, run: FaultTargets, begun: Any) -> None:
        for each in self.agents:
            run.revive(each)


class Remembering(Halt):
    """Keeps state for its end in an attribute."""

    def begin(self, run: FaultTargets) -> Any:
        self.begun = run.now
        super().begin(run)


class Drawing(Halt):
    """Draws from the global generator."""

    def begin(self, run: FaultTargets) -> Any:
        np.random.rand()  # noqa: NPY002
        super().begin(run)


class Timed(Halt):
    """Reads the clock in `end`."""

    def end(self, run: FaultTargets, begun: Any) -> None:
        time.perf_counter()
        super().end(run, begun)


class Mute(Halt):
    """Has an empty text."""

    @property
    def text(self) -> str:
        return ""


class Placeless(Halt):
    """Has an unknown source."""

    @property
    def source(self) -> str:
        return "somewhere"


class Sudden(Halt):
    """Does not last, but implements `end`."""

    lasts: ClassVar = False


class Failing(Halt):
    """Fails as it begins."""

    def begin(self, run: FaultTargets) -> Any:
        raise LookupError("no switch")


class FailingLater(Halt):
    """Fails as it ends."""

    def end(self, run: FaultTargets, begun: Any) -> None:
        raise LookupError("no switch any more")


class Captive(Halt):
    """Returns a value that cannot be captured."""

    def begin(self, run: FaultTargets) -> Any:
        super().begin(run)
        return (number for number in range(3))


BROKEN: dict[type[Fault], tuple[str, ...]] = {
    Remembering: ("Remembering.begin (", "changes self.begun", "return what `end` needs from `begin`"),
    Drawing: ("Drawing.begin (", "the global generator of NumPy"),
    Timed: ("Timed.end (", "`time.perf_counter`"),
    Mute: ("Mute.text (", "is ''", "a few words in one line"),
    Placeless: ("Placeless.source (", "is 'somewhere'"),
    Sudden: ("Sudden.end", "is never called, as `lasts` is False"),
    Failing: ("Failing.begin (test_fault_check.py, line", "raises LookupError: no switch"),
    FailingLater: ("FailingLater.end (test_fault_check.py, line", "no switch any more"),
    Captive: ("Captive (", "has a state that cannot be captured"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_fault_is_named_with_the_method_and_a_correction(kind: type[Fault]) -> None:
    said = deviations(check_fault, kind)
    for words in BROKEN[kind]:
        assert words in said


def test_a_fault_that_undoes_its_effect_conforms() -> None:
    check_fault(Halt, of="robot.1")


def test_a_fault_that_does_not_begin_within_the_run_is_reported() -> None:
    assert "Halt.begin (" in deviations(check_fault, Halt, {"faults.it.at": 5.0})
