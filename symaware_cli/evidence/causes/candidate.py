"""Possible causes of a violation, which branches can correct: beliefs, messages, faults, promises, components.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

import json
import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from symaware_cli.language.build import Built
from symaware_cli.log import Log


@dataclass(frozen=True, slots=True)
class Candidate(ABC):
    """A possible cause, which a branch can correct.

    Attributes:
        kind: The kind of the candidate.
        treatment: The correction, as the subject of a sentence.
        control: The counterpart of the treatment in the other branch.
    """

    kind: ClassVar[str]
    treatment: ClassVar[str]
    control: ClassVar[str] = "the placebo"

    @property
    @abstractmethod
    def text(self) -> str:
        """A short name of the candidate, for tables."""

    @property
    @abstractmethod
    def noun(self) -> str:
        """A name of the candidate, for sentences."""

    @property
    def group(self) -> str:
        """The group of the candidate, one of `KINDS`."""
        return self.kind if self.kind in KINDS else f"{self.kind}s"

    @property
    def whose(self) -> str | None:
        """The id of the agent whose belief it is, or that receives the messages; None for a fault or a promise."""
        return None

    @property
    def has_placebo(self) -> bool:
        """Whether the other branch has a placebo; if not, nothing is changed in that branch."""
        return True

    def acts_from(self, instant: float) -> bool:
        """Whether a branch that begins at an instant [s] can still correct the candidate."""
        return True

    @property
    def passed(self) -> str:
        """Why branches can no longer correct it, if `acts_from` is false; follows its name in a sentence."""
        return "which was over"

    @abstractmethod
    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that corrects the candidate, or is its placebo, in the notation of scenarios."""

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {"kind": self.kind, "text": self.text, **asdict(self)}


@dataclass(frozen=True, slots=True)
class PairBelief(Candidate):
    """A belief of one agent about another one, which a branch makes true.

    Attributes:
        agent: The id of the believing agent.
        about: The id of the agent that the belief is about.
        part: The part of awareness.
        is_drawn: Whether sensors draw errors of the belief; if not, there is no placebo.
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
        """Whether the belief has random errors."""
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
        lost: The number of messages lost in this run, of those sent between the first instant and the violation.
        late: The number of these messages that arrived late.
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
        """The fault that delivers the messages in time, or draws their losses and delays anew."""
        link = {"sender": self.sender, "receiver": self.receiver}
        return {"deliver": link if truth else {**link, "placebo": True}}


@dataclass(frozen=True, slots=True)
class DeclaredFault(Candidate):
    """A fault of the scenario, which a branch prevents.

    Attributes:
        name: The name of the fault.
        does: The effect of the fault, in a few words.
        begins: The time at which the fault begins [s]; None if it begins with an event.
        ends: The time at which the fault ends [s]; None if it lasts for the rest of the run, or begins with an event.
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
        """Whether there is a placebo: no, as the other branch has the fault."""
        return False

    def acts_from(self, instant: float) -> bool:
        """Whether the fault has not ended before an instant [s]."""
        return self.ends is None or self.begins is None or self.begins >= instant or self.ends > instant

    @property
    def passed(self) -> str:
        """When the fault was over."""
        return f"which was over at {self.ends or 0.0:g} s"

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that prevents this one."""
        return {"prevent": self.name}


@dataclass(frozen=True, slots=True)
class BrokenPromise(Candidate):
    """A broken promise, which is kept in a branch.

    Attributes:
        promise: Its name.
        of: The id of the agent that made it.
        broken: The time at which it was first broken [s].
    """

    kind: ClassVar = "promise"
    treatment: ClassVar = "keeping it"
    control: ClassVar = "leaving it alone"

    promise: str
    of: str
    broken: float

    @property
    def text(self) -> str:
        """The promise in a few words."""
        return f"promise {self.promise} of {self.of}"

    @property
    def noun(self) -> str:
        """The promise in a sentence."""
        return f"the promise {self.promise} of {self.of}"

    @property
    def has_placebo(self) -> bool:
        """The other branch leaves it to the agent whether the promise is kept."""
        return False

    def acts_from(self, instant: float) -> bool:
        """Whether the promise is not broken by then."""
        return instant < self.broken

    @property
    def passed(self) -> str:
        """When the promise was broken."""
        return f"which was broken at {self.broken:g} s"

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that makes the agent keep the promise."""
        return {"keep": {"promise": self.promise, "of": self.of}}


@dataclass(frozen=True, slots=True)
class ComponentAlternative(Candidate):
    """Another component, or the same one with another parameter, that replaces a component in a branch.

    Attributes:
        of: The agents and the name of the component, as in ``robot.2.steer``.
        change: The change, in the form of ``--set``.
        fault: The fault that makes the change: its kind, and the content under this key.
    """

    kind: ClassVar = "component"
    treatment: ClassVar = "the alternative"
    control: ClassVar = "a restart of the component"

    of: str
    change: str
    fault: Mapping[str, Any] = field(hash=False)

    @property
    def text(self) -> str:
        """The component and its alternative in a few words."""
        ((kind, content),) = self.fault.items()
        if kind == "replace":
            return f"{self.of} as {content['use']}"
        return f"{self.of} with {', '.join(f'{name}={_plain(value)}' for name, value in content['with'].items())}"

    @property
    def noun(self) -> str:
        """The component in a sentence."""
        return f"the component {self.of}"

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that puts the alternative in place, or restarts the component, as an alternative begins anew."""
        return self.fault if truth else {"restart": self.of}


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)


#: The kinds of candidates, as they are chosen.
KINDS = ("beliefs", "messages", "faults", "promises", "components")


def command(candidates: Sequence[Candidate], log: Path, instant: float) -> str:
    """Return the command that repeats the run of a log with some candidates corrected from an instant on."""
    names = ["true"] if len(candidates) == 1 else [f"true-{number}" for number in range(1, len(candidates) + 1)]
    changes = (
        f"faults.{name}={json.dumps(each.document(truth=True))}" for name, each in zip(names, candidates, strict=True)
    )
    sets = " ".join(f"--set {shlex.quote(each)}" for each in changes)
    return f"symaware branch {shlex.quote(str(log))} --at {instant:g} {sets}"


def beliefs_of(built: Built) -> list[PairBelief]:
    """List the beliefs in a scenario that may be wrong, in the order of the agents.

    These are beliefs about states that sensors measure with errors, delays or gaps, or that messages contain, and
    beliefs about intents that messages contain. An agent's belief about itself is included if its own state is measured
    with errors. If faults are declared, beliefs from exact sensors are included, since a fault may make a sensor
    inexact.
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


def promises_of(built: Built, log: Log, specification: str, violated: float) -> list[BrokenPromise]:
    """List the promises that were broken in a run until a violation, in the order of their names.

    A promise is a specification of its name as well, so the log contains the time at which it was broken. That
    specification itself is not explained by the promise.

    Args:
        built: The scenario.
        log: The log of the run.
        specification: The name of the violated specification.
        violated: The time of the violation [s].
    """
    section = built.sections.get("promises")
    if section is None:
        return []
    broken = [event for event in log.events() if event.name == "violated" and event.time / 1e9 <= violated]
    found = []
    for each in section.promises:
        if each.name == specification:
            continue
        for event in broken:
            # A specification about one agent of a group is one about the world, and names no agents.
            agents = event.data.get("agents") or [each.of]
            if event.source == f"specifications.{each.name}" and each.of in agents:
                found.append(BrokenPromise(each.name, each.of, event.time / 1e9))
                break
    return found
