"""What may have caused a violation: a belief of one agent about another one, which a branch makes true."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from symaware_cli.language.build import Built


@dataclass(frozen=True, slots=True)
class Candidate:
    """A belief.

    Attributes:
        agent: The id of the believing agent.
        about: The id of the agent that it is about.
        part: The part of awareness.
        is_drawn: Whether sensors draw errors of it; if not, the placebo changes nothing.
    """

    agent: str
    about: str
    part: str
    is_drawn: bool

    @property
    def text(self) -> str:
        """The belief in a few words."""
        about = "itself" if self.agent == self.about else self.about
        return f"{self.agent} about {about}" + ("" if self.part == "state" else f": {self.part}")

    def document(self, *, truth: bool) -> Mapping[str, Any]:
        """The fault that makes the belief true, or is its placebo, in the notation of scenarios."""
        written: dict[str, Any] = {"agent": self.agent, "about": self.about, "part": self.part}
        return {"believe": written if truth else {**written, "truth": False}}

    def command(self, log: Path, instant: float) -> str:
        """The command that repeats the run of a log with this belief true from an instant on."""
        change = f"faults.true={json.dumps(self.document(truth=True))}"
        return f"symaware branch {shlex.quote(str(log))} --at {instant:g} --set {shlex.quote(change)}"

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return asdict(self)


def beliefs_of(built: Built) -> list[Candidate]:
    """List the beliefs in a scenario that may be wrong, in the order of the agents.

    These are states that sensors measure with errors, delays or not always, or that messages tell, and intents of
    others where messages tell them. A belief about oneself is one of them if the own state is measured with errors.
    Where faults are declared, exact sensors are included: a fault may make them inexact.
    """
    simulation = built.simulation
    ids = [id for group in simulation.groups for id in group.ids]
    found: list[Candidate] = []
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
                    found.append(Candidate(id, about, "state", drawn))
                elif about != id:
                    found += [Candidate(id, about, "state", drawn)] if others else []
                    found += [Candidate(id, about, "intent", False)] if told else []
    return found
