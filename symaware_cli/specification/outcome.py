"""What has become of a specification in a run, in a few figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import nanoseconds, seconds
from symaware_cli.specification.formula import Array

#: Verdicts as they are shown, from the worst to the best.
VERDICTS: Mapping[int, str] = {-1: "violated", 0: "undecided", 1: "satisfied"}


@dataclass(frozen=True, slots=True)
class Decision:
    """A verdict and what decided it.

    Attributes:
        specification: The specification's name.
        agents: Whom it is about; nobody where it is about the world.
        satisfied: The verdict.
        predicate: The predicate that decided it; empty where none did.
        formula: The smallest temporal formula around that.
        instant: The instant whose value decided it, in nanoseconds; None where there was none.
        robustness: The predicate's robustness then, positive where it holds; infinite for what is just true or false.
        holds: Whether the predicate holds then.
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
        """What decided it, in one sentence."""
        if self.instant is None:
            return f"`{self.formula}` is about no instant"
        if not self.predicate:
            return f"decided at {seconds(self.instant):g} s"
        margin = f" by {abs(self.robustness):.6g}" if np.isfinite(self.robustness) else ""
        return f"`{self.predicate}` {'holds' if self.holds else 'fails'}{margin} at {seconds(self.instant):g} s"

    @property
    def severity(self) -> tuple[bool, float]:
        """Orders decisions, the worst first."""
        return self.satisfied, self.robustness if self.holds == self.satisfied else -self.robustness

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        found = asdict(self)
        found["agents"] = list(self.agents)
        found["instant"] = None if self.instant is None else seconds(self.instant)
        found["robustness"] = self.robustness if np.isfinite(self.robustness) else None
        return found

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Decision:
        """Make one of what `to_json` returned.

        Raises:
            ValueError: It is something else.
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
    """What has become of a specification.

    Attributes:
        name: Its name.
        formula: The formula.
        verdict: ``satisfied``, ``violated`` or ``undecided``: the worst of all agents or pairs that it is about.
        counts: How many of them have each verdict.
        robustness: The least robustness, or the greatest that it can still turn out to be; None where it is not known.
        is_exact: Whether it is the robustness itself.
        agents: Whom that concerns.
        time: When the value was that decided the verdict [s]; None where nothing did.
        reason: What decided the worst verdict; empty where nothing did.
        presumably: ``satisfied`` or ``violated``: what the verdict would be if the run ended now, of an undecided
            formula of linear temporal logic; None for others.
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
        """Return it as plain data."""
        return asdict(self)

    def __str__(self) -> str:
        count, several = self.counts[self.verdict], sum(self.counts.values())
        told = self.name if several == 1 else f"{self.name} by {count:,} of {several:,}"
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
) -> Outcome:
    """Sum up a specification.

    Args:
        name: Its name.
        formula: The formula.
        agents: Tells whom a row is about.
        verdicts: The verdict of each row that was ever there.
        robustness: The exact robustness of each, NaN where it is not known.
        upper: The greatest that it can turn out to be.
        decisions: What decided the verdicts.
        presumption: The worst verdict if the run ended now; None where that is not known.
    """
    worst = int(verdicts.min()) if len(verdicts) else 0
    known = np.where(np.isnan(robustness), upper, robustness)
    row = int(known.argmin()) if len(known) and np.isfinite(known.min()) else None
    decided = [each for each in decisions if worst and each.satisfied == (worst > 0)]
    decision = min(decided, key=lambda each: each.severity, default=None)
    if decision is not None and worst < 0:
        who = decision.agents
    else:
        who = agents(row) if row is not None else ()
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
