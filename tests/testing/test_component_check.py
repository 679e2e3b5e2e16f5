"""Components that break a rule are named, with the method, the line, and a correction."""

import datetime
import random
import time
from collections.abc import Mapping
from datetime import datetime as moment
from itertools import count
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations, is_located
from numpy.typing import NDArray
from pydantic import Field

import symaware_cli
from symaware_cli import (
    Agent,
    AwarenessDatabase,
    CommunicationSender,
    Component,
    Controller,
    GroupComponent,
    KnowledgeDatabase,
    Level,
    Message,
    Quantity,
    RiskEstimator,
    Signal,
    TimeSeries,
)
from symaware_cli.testing import ConformanceError, check_component


class Still(Controller):
    """A valid component that requests no motion."""

    def _compute(self) -> Any:
        return [0.0, 0.0], TimeSeries()


class Draws(Still):
    """Draws from the global generator of NumPy."""

    def _compute(self) -> Any:
        return np.random.rand(2), TimeSeries()  # noqa: NPY002


class Seeds(Still):
    """Seeds the global generator of NumPy."""

    def _compute(self) -> Any:
        np.random.seed(1)  # noqa: NPY002
        return [0.0, 0.0], TimeSeries()


class Rolls(Still):
    """Draws from the global generator of Python."""

    def _compute(self) -> Any:
        return [random.random(), 0.0], TimeSeries()


class Unseeded(Still):
    """Draws from a generator without a seed."""

    def _compute(self) -> Any:
        return np.random.default_rng().random(2), TimeSeries()


class Looks(Still):
    """Reads the clock by its module."""

    def _compute(self) -> Any:
        return [0.0 * time.time(), 0.0], TimeSeries()


class Stops(Still):
    """Reads the clock by a function that was imported."""

    def _compute(self) -> Any:
        return [0.0 * perf_counter(), 0.0], TimeSeries()


class Ticks(Still):
    """Reads the monotonic clock."""

    def _compute(self) -> Any:
        return [0.0 * time.monotonic_ns(), 0.0], TimeSeries()


class Dates(Still):
    """Asks for the date by its module."""

    def _compute(self) -> Any:
        return [0.0 * datetime.datetime.now().hour, 0.0], TimeSeries()


class Days(Still):
    """Asks for the date by a class that was imported."""

    def _compute(self) -> Any:
        return [0.0 * moment.today().hour, 0.0], TimeSeries()


class LooksLater(Still):
    """Reads the clock in `_update`."""

    def _update(self, value: Any) -> None:
        time.time()
        super()._update(value)


class Counts(Still):
    """Counts its computations, in an attribute."""

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self.count = 0

    def _compute(self) -> Any:
        self.count += 1
        return [0.0, 0.0], TimeSeries()


class Appends(Counts):
    """Changes a list within an attribute."""

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self.seen: dict[str, list[float]] = {"times": []}

    def _compute(self) -> Any:
        self.seen["times"].append(self.time)
        return [0.0, 0.0], TimeSeries()


class Steers(Still):
    """Sets the control input too early."""

    def _compute(self) -> Any:
        self._agent.model.control_input = [self.time + 0.1, 0.0]
        return [0.0, 0.0], TimeSeries()


class Warns(Still):
    """Writes the risk too early."""

    def _compute(self) -> Any:
        self._agent.self_awareness.risk = TimeSeries({self.time: [0.5]})
        return [0.0, 0.0], TimeSeries()


class Learns(Still):
    """Writes knowledge too early."""

    def _compute(self) -> Any:
        self._agent.self_knowledge["seen"] = self.now
        return [0.0, 0.0], TimeSeries()


class Cries(Still):
    """Fires an event too early."""

    events: ClassVar = {"cried": "It cried."}

    def _compute(self) -> Any:
        self.emit("cried", "too early")
        return [0.0, 0.0], TimeSeries()


class Tells(CommunicationSender):
    """Sends a message too early."""

    def _compute(self) -> Any:
        self.send(Message(self._agent.id, "robot.0", {"state": self._agent.self_state}))
        return []


class Undeclared(Still):
    """Fires an event that it does not declare."""

    def _update(self, value: Any) -> None:
        super()._update(value)
        self.emit("surprised", level=Level.WARNING)


class Meaningless(Still):
    """Declares an event without a meaning."""

    events: ClassVar = {"arrived": ""}


class Unnumbered(Still):
    """Returns NaN."""

    def _compute(self) -> Any:
        return [np.nan, 0.0], TimeSeries()


class Endless(RiskEstimator):
    """Returns an infinite risk."""

    def _compute(self) -> Any:
        return TimeSeries({self.time: [np.inf]})


class Wide(Still):
    """Returns three numbers for two inputs."""

    def _compute(self) -> Any:
        return [0.0, 0.0, 0.0], TimeSeries()


class Bare(Still):
    """Returns no intent."""

    def _compute(self) -> Any:
        return [0.0, 0.0]


class Nothing(Still):
    """Returns nothing."""

    def _compute(self) -> Any:
        return None


class Branches(GroupComponent):
    """Branches on an array."""

    def _compute(self) -> Any:
        if self._group.awareness.state[:, 0] > 1.0:
            return 1.0
        return 0.0

    def _update(self, value: Any) -> None: ...


class Overwrites(GroupComponent):
    """Writes into the awareness of its group."""

    def _compute(self) -> Any:
        self._group.awareness.state[:, 0] = 0.0

    def _update(self, value: Any) -> None: ...


class Fails(Still):
    """Raises an exception."""

    def _compute(self) -> Any:
        raise KeyError("no map")


class FailsToBegin(Still):
    """Raises an exception as it is initialised."""

    def initialise_component(self, *arguments: Any) -> None:
        super().initialise_component(*arguments)
        raise OSError("no camera")


class Mutates(GroupComponent):
    """Changes the value that it was given."""

    def _compute(self) -> Any:
        return np.zeros(len(self._group))

    def _update(self, value: Any) -> None:
        value += 1.0


NUMBERS = count()


class Shares(Component):
    """Keeps a number for all runs of the process."""

    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        self._agent.self_knowledge["number"] = next(NUMBERS)


class Memory:
    """A total outside of the component."""

    total = 0.0


class Forgets(Component):
    """Keeps its state outside of captured attributes, but resets it in each run."""

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        Memory.total = 0.0

    def _compute(self) -> Any:
        return self.time

    def _update(self, value: Any) -> None:
        Memory.total += value
        self._agent.self_knowledge["total"] = Memory.total


class Captive(Still):
    """Has an attribute that cannot be captured."""

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self.stream = (number for number in range(3))


class Sums(GroupComponent):
    """Adds up rows, although those of a batch belong to several runs."""

    batchable: ClassVar = True

    def _compute(self) -> Any:
        mean: NDArray[np.float64] = self._group.awareness.state[:, :2].mean(axis=0)
        return np.broadcast_to(0.1 * mean, (len(self._group), 2))

    def _update(self, value: Any) -> None:
        self._group.control_input = value


class Undescribed(Still):
    """Has a parameter without a description."""

    class Parameters(symaware_cli.Parameters):
        """One number."""

        gain: float = 1.0


class Unnamed(Still):
    """Has a signal with a column that has no name."""

    signals: ClassVar = (Signal("effort", "vector", [Quantity("", "W")]),)


class Silent(Still):
    __doc__ = ""


class Incomplete(Controller):
    """Does not implement `_compute`."""


class Stranger:
    """Is no component."""


class Needy(Still):
    """Needs knowledge that the scenario of the check does not have."""

    knowledge: ClassVar = {"map": "where to go"}


class Demanding(Still):
    """Refuses the group of the check."""

    def check(self, group: Any) -> None:
        raise ValueError("it needs wings")


BROKEN: dict[type, tuple[str, ...]] = {
    Draws: ("Draws._compute (", "draws from the global generator of NumPy", "self.random"),
    Seeds: ("Seeds._compute (", "draws from the global generator of NumPy"),
    Rolls: ("Rolls._compute (", "draws from the global generator of Python", "self.random"),
    Unseeded: ("Unseeded._compute (", "another value when it is called again", "self.random"),
    Looks: ("Looks._compute (", "reads the wall clock (`time.time`)", "use `self.time`"),
    Stops: ("Stops._compute (", "reads the wall clock (`time.perf_counter`)", "use `self.time`"),
    Ticks: ("Ticks._compute (", "`time.monotonic_ns`"),
    Dates: ("Dates._compute (", "`datetime.now`"),
    Days: ("Days._compute (", "`datetime.today`"),
    LooksLater: ("LooksLater._update (", "`time.time`"),
    Counts: ("Counts._compute (", "changes self.count", "in `_update`"),
    Appends: ("Appends._compute (", "changes self.seen"),
    Steers: ("Steers._compute (", "changes the control input"),
    Warns: ("Warns._compute (", "changes the risk"),
    Learns: ("Learns._compute (", "changes the knowledge"),
    Cries: ("Cries._compute (", "fires `cried`", "do that in `_update`"),
    Tells: ("Tells._compute (", "fires `a message`"),
    Undeclared: ("Undeclared.emit", "the event `surprised`, which `events` does not declare", "events = {'surprised'"),
    Meaningless: ("Meaningless.events (", "does not say what `arrived` means"),
    Unnumbered: ("Unnumbered._update", "at 0 s: its control input is not finite"),
    Endless: ("Endless._update", "its risk"),
    Wide: ("Wide._compute (", "control input of shape (3,)", "2 numbers (speed, turn_rate)"),
    Bare: ("Bare._compute (", "`_compute` returned a list", "return control_input, TimeSeries()"),
    Nothing: ("Nothing._compute (", "`_compute` returned nothing (None)"),
    Branches: ("Branches._compute (", "branches on an array", "np.where"),
    Overwrites: ("Overwrites._compute (", "writes into an array that it was given", "compute a new array"),
    Fails: ("Fails._compute (", "raises KeyError: 'no map'"),
    FailsToBegin: ("FailsToBegin.initialise_component (", "raises OSError: no camera"),
    Mutates: ("Mutates._update (", "changes the value that it was given", "change a copy"),
    Shares: ("Shares._compute (", "is not repeatable: in a second run", "the knowledge of robot differs"),
    Forgets: ("Forgets._compute (", "does not continue alike from a captured state", "keep its state"),
    Captive: ("Captive (", "has a state that cannot be captured", "stream", "keep its state in attributes"),
    Sums: ("Sums.batchable", "is declared, but the run with seed", "let each row depend on its own run only"),
    Undescribed: ("Undescribed.Parameters (", "does not describe `gain`", "Field(description=...)"),
    Unnamed: ("Unnamed.signals (", "a column of `effort` without name", 'Quantity("distance", "m")'),
    Silent: ("Silent (", "has no docstring"),
    Incomplete: ("Incomplete (", "does not implement _compute", "derives from Component or GroupComponent"),
    Stranger: ("Stranger (", "is not a subclass of Component or GroupComponent"),
    Needy: ("Needy (", "cannot be put into the scenario", "the knowledge `map`", "where to go"),
    Demanding: ("Demanding (", "it needs wings", "give its parameters as keywords"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_component_is_named_with_the_method_and_a_correction(kind: type[Component]) -> None:
    said = deviations(check_component, kind)
    for words in BROKEN[kind]:
        assert words in said


@pytest.mark.parametrize(
    "kind",
    [Draws, Looks, Stops, Dates, LooksLater, Counts, Steers, Branches, Overwrites, Fails, FailsToBegin, Shares, Silent],
    ids=lambda kind: kind.__name__,
)
def test_the_place_is_a_line_of_the_component_itself(kind: type[Component]) -> None:
    assert is_located(deviations(check_component, kind), kind)


class Gusts(Still):
    """Draws from `self.random`, and stores state in `_update`."""

    events: ClassVar = {"gusted": "The wind turned."}

    class Parameters(symaware_cli.Parameters):
        """The wind."""

        strength: float = Field(0.1, ge=0, description="Standard deviation of the speed [m/s].")

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self.last = 0.0

    def _compute(self) -> Any:
        speed = 0.5 * self.last + self.parameters.strength * self.random.standard_normal()
        return [speed, 0.0], TimeSeries()

    def _update(self, value: Any) -> None:
        super()._update(value)
        if value[0][0] * self.last < 0:
            self.emit("gusted")
        self.last = value[0][0]


def test_a_component_with_random_draws_and_a_memory_conforms() -> None:
    check_component(Still)
    check_component(Gusts, strength=0.3)


class Waits(Still):
    """Lets time pass within its turns."""

    async def _async_compute(self) -> Any:
        await self.sleep(0.01)
        return self._compute()


def test_a_component_that_waits_within_its_turns_conforms() -> None:
    check_component(Waits)


def test_the_scenario_can_be_changed_for_a_component_that_needs_more() -> None:
    check_component(Needy, {"agents.robot.knowledge.map": [1.0, 2.0], "agents.robot.count": 1})


def replaceable() -> list[Any]:
    """The functions of the clock, and the states of the global generators."""
    clocks = [time.time, time.perf_counter, datetime.datetime, moment, perf_counter]
    return [*clocks, random.getstate(), str(np.random.get_state())]  # noqa: NPY002


def test_replaced_functions_are_restored_after_a_check() -> None:
    before = replaceable()
    for kind in (Looks, Stops, Dates, Draws, Fails):
        with pytest.raises(ConformanceError):
            check_component(kind)
    assert replaceable() == before


def test_each_deviation_is_a_separate_line() -> None:
    class Double(Still):
        """Breaks two rules."""

        def _compute(self) -> Any:
            self.noise = np.random.rand()  # noqa: NPY002
            return [time.time() * 0, 0], TimeSeries()

    said = deviations(check_component, Double)
    assert len(said.splitlines()) == 3
    assert "self.noise" in said
