"""Results of a specification in a run: decisions with their reasons, and a summary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import nanoseconds, seconds
from symaware_cli.specification.formula import Array

#: Names of the verdicts, from the worst to the best.
VERDICTS: Mapping[int, str] = {-1: "violated", 0: "undecided", 1: "satisfied"}

#: The verdict of an offered specification that no agent accepted.
REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class Decision:
    """A verdict and the value that decided it.

    Attributes:
        specification: The specification's name.
        agents: The agents it concerns; empty if it concerns the world.
        satisfied: The verdict.
        predicate: The predicate that decided it; empty if none did.
        formula: The formula directly above the predicate; without a predicate, the formula that decided it.
        instant: The instant whose value decided it, in nanoseconds; None if there was none.
        robustness: The robustness of the predicate at that instant, positive where it holds; infinite for Boolean
            values.
        holds: Whether the predicate holds at that instant.
    """

    specification: str
    agents: tuple[str, ...]
    satisfied: bool
    predicate: str
    formula: str
    instant: int | None
    robustness: float
    holds: bool

    @property
    def reason(self) -> str:
        """The reason for the verdict, in one sentence."""
        if self.instant is None:
            return f"`{self.formula}` is about no instant"
        if not self.predicate:
            return f"decided at {seconds(self.instant):g} s"
        margin = f" by {abs(self.robustness):.6g}" if np.isfinite(self.robustness) else ""
        return f"`{self.predicate}` {'holds' if self.holds else 'fails'}{margin} at {seconds(self.instant):g} s"

    @property
    def severity(self) -> tuple[bool, float]:
        """Sort key of decisions, the worst first."""
        return self.satisfied, self.robustness if self.holds == self.satisfied else -self.robustness

    def to_json(self) -> dict[str, Any]:
        """Return the decision as plain data."""
        found = asdict(self)
        found["agents"] = list(self.agents)
        found["instant"] = None if self.instant is None else seconds(self.instant)
        found["robustness"] = self.robustness if np.isfinite(self.robustness) else None
        return found

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Decision:
        """Create a decision from the data that `to_json` returned.

        Raises:
            ValueError: The data do not describe a decision.
        """
        try:
            instant, robustness = data["instant"], data["robustness"]
            return cls(
                specification=str(data["specification"]),
                agents=tuple(map(str, data["agents"])),
                satisfied=bool(data["satisfied"]),
                predicate=str(data["predicate"]),
                formula=str(data["formula"]),
                instant=None if instant is None else nanoseconds(instant),
                robustness=np.inf if robustness is None else float(robustness),
                holds=bool(data["holds"]),
            )
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"this is no verdict: {error}") from error


@dataclass(frozen=True, slots=True)
class Outcome:
    """The summary of a specification at the end of a run, or so far.

    Attributes:
        name: Name of the specification.
        formula: Its formula.
        verdict: ``satisfied``, ``violated`` or ``undecided``: the worst of all agents or pairs that it is about; or
            ``rejected``, if it was offered and nobody took it.
        counts: The number of agents or pairs with each verdict.
        robustness: The least exact robustness, or an upper bound of it; None where neither is known.
        is_exact: Whether `robustness` is exact rather than an upper bound.
        agents: The agents that `robustness` or, if it is violated, the worst decision belongs to.
        time: The time of the value that decided the verdict [s]; None if nothing did.
        reason: What decided the worst verdict; empty if nothing did.
        presumably: The verdict if the run ended now, ``satisfied`` or ``violated``, for an undecided formula of linear
            temporal logic; None for others.
    """

    name: str
    formula: str
    verdict: str
    counts: Mapping[str, int]
    robustness: float | None
    is_exact: bool
    agents: tuple[str, ...]
    time: float | None
    reason: str
    presumably: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Outcome:
        """Create an outcome from the data that `to_json` returned; keys that this version does not know are ignored."""
        known = {each.name: data[each.name] for each in fields(cls) if each.name in data}
        return cls(**{**known, "agents": tuple(data["agents"])})

    def rejected(self, reason: str) -> Outcome:
        """Return the outcome of a specification that was offered and that no agent accepted."""
        return replace(self, verdict=REJECTED, reason=reason)

    def __str__(self) -> str:
        if self.verdict == REJECTED:
            return f"{self.name}: {self.reason}"
        count, several = self.counts[self.verdict], sum(self.counts.values())
        told = self.name if several <= 1 else f"{self.name} by {count:,} of {several:,}"
        if self.robustness is not None:
            told += f", robustness {'' if self.is_exact else 'at most '}{self.robustness:.6g}"
        if self.presumably:
            told += f", presumably {self.presumably}"
        who = f" ({' and '.join(self.agents)})" if self.agents else ""
        return f"{told}: {self.reason}{who}" if self.reason else f"{told}{who}"


def outcome_of(
    name: str,
    formula: str,
    agents: Callable[[int], tuple[str, ...]],
    verdicts: NDArray[np.int8],
    robustness: Array,
    upper: Array,
    decisions: Iterable[Decision],
    presumption: int | None = None,
    explained: Callable[[int], Decision | None] = lambda row: None,
) -> Outcome:
    """Summarise a specification.

    Args:
        name: Its name.
        formula: Its formula.
        agents: Returns the agents that a row is about.
        verdicts: The verdict of each row that was ever present.
        robustness: The exact robustness of each row, NaN where it is unknown.
        upper: The upper bound of the robustness of each row.
        decisions: The decisions so far.
        presumption: The worst verdict if the run ended now; None where that is unknown.
        explained: Returns what accounts for the robustness, or the upper bound of it, that is known of a row.
    """
    worst = int(verdicts.min()) if len(verdicts) else 0
    known = np.where(np.isnan(robustness), upper, robustness)
    row = int(known.argmin()) if len(known) and np.isfinite(known.min()) else None
    decided = [each for each in decisions if worst and each.satisfied == (worst > 0)]
    decision = min(decided, key=lambda each: each.severity, default=None)
    if decision is not None and row is not None:
        # What decided the verdict need not account for the robustness, which other samples may have changed since.
        of_robustness = explained(row)
        if of_robustness is not None:
            decision = of_robustness
        elif abs(decision.robustness) != abs(known[row]):
            decision = replace(decision, robustness=np.inf)
    who = agents(row) if row is not None else ()
    if decision is not None and (worst < 0 or not who):
        who = decision.agents
    return Outcome(
        name=name,
        formula=formula,
        verdict=VERDICTS[worst],
        counts={word: int((verdicts == verdict).sum()) for verdict, word in VERDICTS.items()},
        robustness=None if row is None else float(known[row]),
        is_exact=row is not None and not np.isnan(robustness[row]),
        agents=who,
        time=None if decision is None or decision.instant is None else seconds(decision.instant),
        reason=decision.reason if decision else "",
        presumably=VERDICTS[presumption] if presumption and not worst else None,
    )
