"""What may have caused a violation, and can be otherwise in a branch: beliefs, messages, and declared faults."""

from __future__ import annotations

import json
import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from symaware_cli.language.build import Built


@dataclass(frozen=True, slots=True)
class Candidate(ABC):
    """Something that can be made right in a branch.

    Attributes:
        kind: What it is.
        treatment: What is done about it, as the subject of a sentence.
        control: What the other branch has instead.
    """

    kind: ClassVar[str]
    treatment: ClassVar[str]
    control: ClassVar[str] = "the placebo"

    @property
    @abstractmethod
    def text(self) -> str:
        """Names it in a few words, in a table."""

    @property
    @abstractmethod
    def noun(self) -> str:
        """Names it in a sentence."""

    @property
    def group(self) -> str:
        """Which of `KINDS` it is one of."""
        return self.kind if self.kind in KINDS else f"{self.kind}s"

    @property
    def whose(self) -> str | None:
        """The id of the agent whose belief it is, or that receives the messages; None for a fault."""
        return None

    @property
    def has_placebo(self) -> bool:
        """Whether the other branch has a placebo; if not, it is a future in which nothing is done."""
        return True

    def acts_from(self, instant: float) -> bool:
        """Whether a branch from an instant on [s] can still make it right."""
        return True

    @abstractmethod
    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that makes it right, or is its placebo, in the notation of scenarios."""

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {"kind": self.kind, "text": self.text, **asdict(self)}


@dataclass(frozen=True, slots=True)
class PairBelief(Candidate):
    """A belief of one agent about another one, which a branch makes true.

    Attributes:
        agent: The id of the believing agent.
        about: The id of the agent that it is about.
        part: The part of awareness.
        is_drawn: Whether sensors draw errors of it; if not, it has no placebo.
    """

    kind: ClassVar = "belief"
    treatment: ClassVar = "truth"

    agent: str
    about: str
    part: str
    is_drawn: bool

    @property
    def text(self) -> str:
        """The belief in a few words."""
        about = "itself" if self.agent == self.about else self.about
        return f"{self.agent} about {about}" + ("" if self.part == "state" else f": {self.part}")

    @property
    def noun(self) -> str:
        """The belief in a sentence."""
        return f"what {self.agent} believed about {'itself' if self.agent == self.about else self.about}"

    @property
    def whose(self) -> str | None:
        """The believing agent."""
        return self.agent

    @property
    def has_placebo(self) -> bool:
        """Whether something is drawn for it."""
        return self.is_drawn

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that makes the belief true, or draws its errors anew."""
        written: dict[str, Any] = {"agent": self.agent, "about": self.about, "part": self.part}
        return {"believe": written if truth else {**written, "truth": False}}


@dataclass(frozen=True, slots=True)
class LinkMessages(Candidate):
    """The messages of a link, which a branch delivers in time.

    Attributes:
        sender: The id of the sender.
        receiver: The id of the receiver.
        lost: How many of them were lost in this run, of those sent between the first instant and the violation.
        late: How many of them arrived late.
    """

    kind: ClassVar = "messages"
    treatment: ClassVar = "arrival in time"

    sender: str
    receiver: str
    lost: int
    late: int

    @property
    def text(self) -> str:
        """The link in a few words."""
        return f"messages {self.sender} to {self.receiver}"

    @property
    def noun(self) -> str:
        """The messages in a sentence."""
        return f"messages from {self.sender} to {self.receiver}"

    @property
    def whose(self) -> str | None:
        """The receiver."""
        return self.receiver

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that delivers the messages in time, or draws their fates anew."""
        link = {"sender": self.sender, "receiver": self.receiver}
        return {"deliver": link if truth else {**link, "placebo": True}}


@dataclass(frozen=True, slots=True)
class DeclaredFault(Candidate):
    """A fault of the scenario, which a branch prevents.

    Attributes:
        name: The name of the fault.
        does: What it does.
        begins: When it begins [s]; None with an event.
        ends: When it is over [s]; None for the rest of the run, or if it begins with an event.
    """

    kind: ClassVar = "fault"
    treatment: ClassVar = "its absence"
    control: ClassVar = "its presence"

    name: str
    does: str
    begins: float | None
    ends: float | None

    @property
    def text(self) -> str:
        """The fault in a few words."""
        return f"fault {self.name}"

    @property
    def noun(self) -> str:
        """The fault in a sentence."""
        return f"the fault {self.name}"

    @property
    def has_placebo(self) -> bool:
        """The other branch has the fault."""
        return False

    def acts_from(self, instant: float) -> bool:
        """Whether the fault is not over by then."""
        return self.ends is None or self.begins is None or self.begins >= instant or self.ends > instant

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that prevents this one."""
        return {"prevent": self.name}


#: The kinds of candidates, as they are chosen.
KINDS = ("beliefs", "messages", "faults")


def command(candidates: Sequence[Candidate], log: Path, instant: float) -> str:
    """The command that repeats the run of a log with some candidates made right from an instant on."""
    names = ["true"] if len(candidates) == 1 else [f"true-{number}" for number in range(1, len(candidates) + 1)]
    changes = (
        f"faults.{name}={json.dumps(each.document(truth=True))}" for name, each in zip(names, candidates, strict=True)
    )
    sets = " ".join(f"--set {shlex.quote(each)}" for each in changes)
    return f"symaware branch {shlex.quote(str(log))} --at {instant:g} {sets}"


def beliefs_of(built: Built) -> list[PairBelief]:
    """List the beliefs in a scenario that may be wrong, in the order of the agents.

    These are states that sensors measure with errors, delays or not always, or that messages tell, and intents of
    others where messages tell them. A belief about oneself is one of them if the own state is measured with errors.
    Where faults are declared, exact sensors are included: a fault may make them inexact.
    """
    simulation = built.simulation
    ids = [id for group in simulation.groups for id in group.ids]
    found: list[PairBelief] = []
    for group in simulation.groups:
        own = others = told = drawn = False
        exact = False
        for entry in simulation.entries:
            if entry.group is not group:
                continue
            component = entry.components[0]
            perceived = component.perceives()
            if perceived or component.sees_world:
                drawn = True
                own |= not perceived.get("own", True)
                others |= not perceived.get("others", True)
                exact |= perceived.get("others", False)
            told |= entry.kinds is not None
        others |= (told and not exact) or bool(built.options.faults and drawn)
        for id in group.ids:
            for about in ids:
                if about == id and own:
                    found.append(PairBelief(id, about, "state", drawn))
                elif about != id:
                    found += [PairBelief(id, about, "state", drawn)] if others else []
                    found += [PairBelief(id, about, "intent", False)] if told else []
    return found


def faults_of(built: Built, violated: float) -> list[DeclaredFault]:
    """List the faults of a scenario that begin before a violation [s], or with an event."""
    found = []
    for fault in built.options.faults:
        begins = None if fault.at is None else fault.at / 1e9
        lasts = fault.lasting if fault.lasts else 0
        ends = None if begins is None or lasts is None else begins + lasts / 1e9
        if begins is None or begins <= violated:
            found.append(DeclaredFault(fault.name, fault.text, begins, ends))
    return found
