"""The explanation of a violation in a file beside the log, as ``symaware explain LOG --json`` wrote it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, ValidationError

from symaware_cli.log import Log, reason
from symaware_cli.log.digest import digest

#: The end of the name of an explanation, after the name of the log without its own.
SUFFIX = ".explain.json"

#: The greatest explanation that is read [bytes].
_MOST_BYTES = 10_000_000

#: A text of the file, and a finite number.
_Text = Annotated[str, Field(max_length=10_000)]
_Number = Annotated[float, Field(allow_inf_nan=False)]


class NamedCandidate(BaseModel):
    """A possible cause.

    Attributes:
        text: Its name.
        agent: The believing agent, of a belief.
        about: The agent that this belief is about.
        sender: The sender, of messages.
        receiver: The receiver, of messages.
        of: The agent of a promise, or the agents and the name of a component.
        kind: Its kind.
    """

    text: _Text
    kind: _Text = ""
    agent: _Text | None = None
    about: _Text | None = None
    sender: _Text | None = None
    receiver: _Text | None = None
    of: _Text | None = None


class LoggedComparison(BaseModel):
    """A comparison in redrawn futures; see `FutureComparison.to_json`."""

    at: _Number
    futures: int
    saved_by_truth: int
    saved_by_placebo: int | None
    difference: _Number | None
    lower: _Number | None
    established: bool

    @property
    def strength(self) -> tuple[bool, float, float]:
        """The order of comparisons: established ones, then by the difference, then the earliest."""
        return self.established, -1.0 if self.difference is None else self.difference, -self.at


class _Saved(BaseModel):
    at: _Number
    saved: bool


class ExplainedCandidate(BaseModel):
    """The findings about a candidate; see `CandidateRow.to_json`."""

    candidate: NamedCandidate
    cause: bool
    compared: bool
    screening: _Text
    in_this_run: list[_Saved]
    in_general: list[LoggedComparison]
    command: _Text


class _Together(BaseModel):
    candidates: list[NamedCandidate]
    in_general: LoggedComparison
    command: _Text


class _Plan(BaseModel):
    instants: list[_Number]


class ExplanationFile(BaseModel):
    """The part of an explanation that is read; see `Explanation.to_json`."""

    digest: _Text
    specification: _Text
    violated: _Number
    text: _Text
    where: _Text
    branches: int
    confidence: _Number
    plan: _Plan
    among_candidates: bool
    everything: list[LoggedComparison] = Field(min_length=1)
    together: _Together | None
    candidates: list[ExplainedCandidate]


def beside(log: Path) -> Path:
    """Return the path of the explanation of a log."""
    return log.with_name(log.stem + SUFFIX)


def read_explanation(path: Path, log: Log) -> ExplanationFile | str:
    """Read an explanation; return the reason if it cannot be shown."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        return f"cannot be read: {reason(error)}"
    if len(data) > _MOST_BYTES:
        return f"has more than {_MOST_BYTES / 1e6:g} MB, which no explanation has"
    try:
        found = ExplanationFile.model_validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        return f"is not what `symaware explain --json` writes: {where + ': ' if where else ''}{first['msg']}"
    if found.digest != digest(log).combined:
        return "explains another log, and is not shown"
    return found
