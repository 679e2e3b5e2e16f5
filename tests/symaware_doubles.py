"""Plugins for tests: components that misbehave in many ways."""

import contextlib
import ctypes
import itertools
import multiprocessing
import os
import random
import signal
import struct
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    CommunicationReceiver,
    Component,
    Controller,
    GroupCommunicationReceiver,
    GroupComponent,
    KnowledgeDatabase,
    Parameters,
    Snapshot,
    TimeSeries,
    processor,
)
from symaware_cli.core import Contact, Delivery, Event, Message
from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.core.message import EVERYBODY
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.world.reading import Scan

#: What tests/conftest.py registers, by entry-point name, beside the paper's controller.
COMPONENTS = {
    "doubles.ear": "Ear",
    "doubles.ears": "Ears",
    "doubles.cautious": "Cautious",
    "doubles.gaze": "Gaze",
    "doubles.fault": "Fault",
    "doubles.progress": "Progress",
    "doubles.sleeper": "Sleeper",
    "doubles.holder": "Holder",
    "doubles.endless": "Endless",
    "doubles.stubborn": "Stubborn",
    "doubles.bulky": "Bulky",
    "doubles.chance": "Chance",
    "doubles.risk": "Risk",
    "doubles.thinker": "Thinker",
    "doubles.keeper": "Keeper",
    "doubles.napper": "Napper",
    "doubles.odd": "Odd",
    "doubles.outsider": "Outsider",
    "doubles.unruly": "Unruly",
    "doubles.kernels": "Kernels",
}
ENVIRONMENTS = {"doubles.faulty-world": "FaultyWorld", "doubles.lonely-world": "LonelyWorld"}
SUBSCRIBERS = {"doubles.watch": "watch", "doubles.refuse": "refuse"}

#: The name and the source of each event that `watch` was called with.
WATCHED: list[tuple[str, str]] = []


def watch(event: Event) -> None:
    """Keeps the events that it is called with."""
    WATCHED.append((event.name, event.source))


def refuse(event: Event) -> None:
    """Raises an exception at every event."""
    raise ValueError(f"{event.name} is refused")


class Idle(GroupComponent):
    """Does nothing with its turns."""

    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        pass


class Fault(Component):
    """Fails for one agent, at one time, in one way."""

    class Parameters(Parameters):
        """Which fault."""

        where: Literal["compute", "update", "initialise", "subscriber", "exit", "unprintable"] = Field(
            "compute", description="Where it raises."
        )
        value: Literal["", "nan", "inf", "-inf"] = Field("", description="What to write instead of raising.")
        into: Literal["control", "state"] = Field("control", description="Where to write it.")
        agent: str = Field("robot.0", description="Whose component fails.")
        at: float = Field(0.0, description="When [s].")

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        if self.parameters.where == "initialise":
            self._fail()
        if self.parameters.where == "subscriber":
            self.subscribe("tick", self._on_tick)

    def _on_tick(self, event: Event) -> None:
        self._fail()

    def _due(self) -> bool:
        return bool(self._agent.id == self.parameters.agent and self.time >= self.parameters.at)

    def _fail(self) -> None:
        if self._agent.id != self.parameters.agent:
            return
        if self.parameters.where == "exit":
            raise SystemExit(0)
        if self.parameters.where == "unprintable":
            raise UnprintableError
        raise ZeroDivisionError("a fault on purpose \udcff \N{SNOWMAN}")

    def _compute(self) -> None:
        if self._due() and not self.parameters.value and self.parameters.where in ("compute", "exit", "unprintable"):
            self._fail()

    def _update(self, value: Any) -> None:
        if not self._due():
            return
        if self.parameters.value:
            bad = float(self.parameters.value)
            if self.parameters.into == "control":
                self._agent.model.control_input = self._agent.control_input + bad
            else:
                self._agent.self_awareness.state = self._agent.self_state + bad
        elif self.parameters.where == "update":
            self._fail()
        elif self.parameters.where == "subscriber":
            self.emit("tick")


class UnprintableError(Exception):
    """Cannot be converted to text."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


class Progress(Idle):
    """Writes down each turn in the file that PROGRESS names: wall time (monotonic, s) and simulated time (ns)."""

    RECORD = struct.Struct("<dq")

    def initialise_component(self, group: AgentGroup) -> None:
        super().initialise_component(group)
        self._file = os.open(os.environ["PROGRESS"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def _update(self, value: Any) -> None:
        os.write(self._file, self.RECORD.pack(time.monotonic(), self.now))

    @classmethod
    def read(cls, path: Path) -> list[tuple[float, int]]:
        """The written records, without a truncated one."""
        data = path.read_bytes() if path.exists() else b""
        return list(cls.RECORD.iter_unpack(data[: len(data) // cls.RECORD.size * cls.RECORD.size]))


class Sleeper(Idle):
    """Takes its time."""

    class Parameters(Parameters):
        """How long."""

        duration: float = Field(0.3, description="Wall time of a turn [s].")
        start: float = Field(0.0, description="Simulated time of the first such turn [s].")

    def _update(self, value: Any) -> None:
        if self.time >= self.parameters.start:
            time.sleep(self.parameters.duration)


class Holder(Idle):
    """Keeps the interpreter's lock for its first turn."""

    class Parameters(Parameters):
        """How long."""

        duration: float = Field(3.0, description="Wall time of the turn [s].")

    def _update(self, value: Any) -> None:
        if self.now == 0:
            # Unlike CDLL, PyDLL does not let go of the lock while it calls.
            ctypes.PyDLL(None).usleep(int(1e6 * self.parameters.duration))


class Endless(Idle):
    """Never comes back from its second turn."""

    def _update(self, value: Any) -> None:
        while self.now:
            pass


class Stubborn(Idle):
    """Catches all exceptions, as careless code does."""

    def _update(self, value: Any) -> None:
        try:
            for _ in range(200):
                time.sleep(0.001)
        except BaseException:
            pass


class Bulky(Idle):
    """Fills the log with numbers that do not compress."""

    def _update(self, value: Any) -> None:
        for row in range(len(self._group)):
            drawn = self.random.standard_normal(200)[row]
            self.emit_for(row, "bulk", data=[round(float(number), 9) for number in drawn])


class Chance(Idle):
    """Depends on what differs between two runs."""

    class Parameters(Parameters):
        """On what."""

        source: Literal["address", "set", "time", "random", "numpy", "processor", "nothing"] = Field(
            description="On what."
        )
        row: int | None = Field(None, description="Whose risk it is; None for everybody's.")

    def _compute(self) -> float:
        match self.parameters.source:
            case "address":
                return id(self) % 1_000_003
            case "set":
                return float(list({"north", "east", "south", "west", "up", "down"}).index("north"))
            case "time":
                return time.time() % 1000
            case "random":
                return random.random()
            case "numpy":
                return np.random.rand()  # noqa: NPY002 (the sin on purpose)
            case "processor":
                # Stands for a library that looks at the processor by itself.
                return float(len(os.environ.get("GLIBC_TUNABLES", "")))
            case _:
                return 0.0

    def _update(self, value: Any) -> None:
        if self.now > 200_000_000:
            own = np.arange(len(self._group)) == self.parameters.row
            everybody = self.parameters.row is None
            self._group.awareness.risk.set(self.now, np.where(own | everybody, value, 0.0))


class Risk(Idle):
    """Sees one and the same risk all the time."""

    class Parameters(Parameters):
        """How much."""

        value: Literal["inf", "1"] = Field(description="The risk.")

    def _update(self, value: Any) -> None:
        self._group.awareness.risk.set(self.now, np.full(len(self._group), float(self.parameters.value)))


class FaultyWorld(KinematicEnvironment):
    """A world that breaks."""

    class Parameters(KinematicEnvironment.Parameters):
        """How and when."""

        where: Literal["step", "state", "snapshot", "contacts", "nan"] = Field("step", description="What breaks.")
        at: float = Field(0.1, description="From when on [s].")

    def _broken(self, what: str) -> None:
        if self.parameters.where == what and self._time >= self.parameters.at * 1e9:
            raise ZeroDivisionError("the world broke on purpose")

    def step(self) -> None:
        self._broken("step")
        super().step()
        if self.parameters.where == "nan" and self._time >= self.parameters.at * 1e9:
            self._states[0] = np.full_like(self._states[0], np.nan)

    def state(self, group: EntityGroup) -> NDArray[np.float64]:
        self._broken("state")
        return super().state(group)

    def snapshot(self) -> Snapshot:
        self._broken("snapshot")
        return super().snapshot()

    def contacts(self) -> Sequence[Contact]:
        self._broken("contacts")
        return super().contacts()


class Odd(Component):
    """Sends values that no protocol supports."""

    class Parameters(Parameters):
        """Where."""

        way: Literal["event", "message"] = Field("event", description="How it says that.")

    def _compute(self) -> set[complex]:
        return {complex(1, 2)}

    def _update(self, value: set[complex]) -> None:
        if self.parameters.way == "event":
            self.emit("odd", "this is odd", what=value)
        else:
            message = Message(self._agent.id, EVERYBODY, {"what": value}, "odd")
            self._agent.group.surroundings.exchange.send(message)


class Ear(CommunicationReceiver):
    """Fires an event for each message that it receives, in order."""

    def _update(self, value: Sequence[Message]) -> None:
        for each in value:
            self.emit("heard", f"{each.arrival_time} {each.sender} {each.sequence}")


class Ears(GroupCommunicationReceiver):
    """Fires an event for each message that its group receives, in order."""

    kinds = ("state", "broadcast")

    def _update(self, value: Sequence[Delivery]) -> None:
        ids = self.environment.roster.ids
        for each in value:
            columns = each.receivers, each.due, each.senders, each.sequences
            for receiver, due, sender, sequence in zip(*(column.tolist() for column in columns), strict=True):
                row = receiver - self.environment.roster.start(self._group.name)
                self.emit_for(row, "heard", f"{due} {ids[sender]} {sequence}")


class LonelyWorld(KinematicEnvironment):
    """A world that other processes cannot follow."""

    is_shared = False


class Kernels(Component):
    """Says what computes where it computes."""

    def _compute(self) -> dict[str, str]:
        return {name: value for name, value in processor.in_force().items() if name != "Processor"}

    def _update(self, value: dict[str, str]) -> None:
        self.emit("kernels", str(value))


class Gaze(Controller):
    """A controller that goes where its lidar sees farthest."""

    def _compute(self) -> tuple[Any, TimeSeries]:
        scan = self._agent.group.awareness.readings["look"]
        assert isinstance(scan, Scan)
        ranges = np.nan_to_num(scan.distances[self._agent.row], posinf=9.0)
        bearing = 2 * np.pi * np.argmax(ranges) / len(ranges)
        way = np.array([np.cos(bearing), np.sin(bearing)])
        return 0.5 * way, TimeSeries({self.time: way})


class Cautious(Controller):
    """Drives the faster, the greater the robustness that `apart` can still turn out to have."""

    def _compute(self) -> tuple[Any, TimeSeries]:
        status = self._agent.specifications["apart"]
        worst = self._agent.group.specifications["apart"].worst
        speed = 0.1 if status.verdict is False or worst.verdict is False else min(1.0, 0.2 + status.interval[1])
        return self._agent.self_knowledge["goal"] * speed, TimeSeries()

    def _update(self, value: tuple[Any, TimeSeries]) -> None:
        self._agent.model.control_input, self._agent.self_awareness.intent = value


class Thinker(Controller):
    """A controller that has state, draws by chance and fires events, as a planner does; and that may die of it."""

    events: ClassVar = {"thought": "It computed."}
    uncaptured: ClassVar = ("_solver",)

    class Parameters(Parameters):
        """What becomes of it."""

        at: float = Field(1e9, description="When it comes to grief [s].")
        how: Literal["raise", "exit", "kill", "hang", "nan"] = Field("raise", description="In which way.")
        agent: str = Field("", description="Whose; empty for everybody's.")

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self._count = 0
        self._last = np.zeros(2)
        self._solver = iter(number for number in range(0))  # a generator cannot be pickled, as many a solver

    def _compute(self) -> tuple[Any, TimeSeries]:
        self._count += 1
        parameters = self.parameters
        if self.time >= parameters.at and parameters.agent in ("", self._agent.id):
            match parameters.how:
                case "raise":
                    raise ZeroDivisionError("on purpose")
                case "exit":
                    os._exit(3)
                case "kill":
                    os.kill(os.getpid(), signal.SIGKILL)
                case "hang":
                    time.sleep(1000)
                case "nan":
                    return [np.nan, 0.0], TimeSeries()
        if self._count % 5 == 0:
            self.emit("thought", f"turn {self._count}", last=self._last.tolist())
        goal = self._agent.self_knowledge["goal"]
        way = 0.3 * (goal - self._agent.self_state) + 0.2 * self._last + 0.1 * self.random.standard_normal(2)
        return way, TimeSeries({self.time: way})

    def _update(self, value: Any) -> None:
        super()._update(value)
        self._last = np.array(value[0])


class Keeper(Thinker):
    """A thinker that keeps something that nobody can take, and tells of it, or does not."""

    uncaptured: ClassVar = ("_vault",)

    class Parameters(Thinker.Parameters):
        """Where it keeps it."""

        hidden: bool = Field(True, description="Whether what it keeps is in an attribute that holds no state.")

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self._vault = (threading.Lock(), [0])
        if not self.parameters.hidden:
            self._lock = threading.Lock()

    def _compute(self) -> tuple[Any, TimeSeries]:
        self._vault[1][0] += 1
        way, intent = super()._compute()
        return way + 0.01 * self._vault[1][0], intent

    def _update(self, value: Any) -> None:
        super()._update(value)
        self._vault[1][0] *= 2

    def captured(self) -> int:
        return self._vault[1][0]

    def restored(self, state: int) -> None:
        self._vault[1][0] = state


class Napper(Component):
    """Sleeps within each turn."""

    async def _async_compute(self) -> None:
        await self.sleep(0.12)

    def _compute(self) -> None:
        """Nothing."""

    def _update(self, value: Any) -> None:
        """Nothing."""


class Unruly(GroupComponent):
    """Does to its process what no component should."""

    class Parameters(Parameters):
        """What, and when."""

        how: Literal["exit", "interrupt", "leave", "thread", "process", "print", "catch", "hold", "release"] = Field(
            "exit", description="What it does."
        )
        at: float = Field(0.2, description="When [s].")

    def _compute(self) -> None:
        if self.now != round(self.parameters.at * 1e9):
            return
        match self.parameters.how:
            case "exit":
                os._exit(0)
            case "interrupt":
                raise KeyboardInterrupt("by a component")
            case "leave":
                raise SystemExit(0)
            case "thread":
                threading.Thread(target=self.linger, name="lingering").start()
            case "process":
                multiprocessing.get_context("spawn").Process(target=time.sleep, args=[1000.0], name="child").start()
            case "print":
                print("printed by a plugin")
                ctypes.CDLL(None).puts(b"printed by a library")
                os.write(1, b"written by a library\n")
            case "catch":
                while True:
                    with contextlib.suppress(BaseException):
                        time.sleep(0.001)
            case "hold" | "release":
                Path(os.environ["PROGRESS"]).with_suffix(".deaf").touch()
                if self.parameters.how == "hold":  # native code that keeps the interpreter
                    sum(itertools.repeat(1, 10**13))
                else:
                    np.broadcast_to(1.0, (10**13,)).sum()

    def linger(self) -> None:
        time.sleep(1000.0)

    def _update(self, value: Any) -> None:
        pass


class Outsider(Controller):
    """Drives at a speed from outside of the run: from a file, if there is one, or drawn without a seed."""

    class Parameters(Parameters):
        """Where the speeds come from."""

        file: str = Field("", description="A file with a speed, read at each turn.")

    def _compute(self) -> tuple[list[float], TimeSeries]:
        speed = self.external_input(self._ask)["speed"]
        return [speed, 0.0], TimeSeries()

    def _ask(self) -> dict[str, float]:
        if not self.parameters.file:
            return {"speed": struct.unpack("<Q", os.urandom(8))[0] / 2**64}
        return {"speed": float(Path(self.parameters.file).read_text())}
