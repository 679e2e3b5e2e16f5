"""One probability of a claim, such as ``P(safe) > 0.99``, ``P(sees and safe) > 0.9`` or ``P(safe | sees) > 0.999``.

Reasons: docs/decisions/0091-awareness-contracts.md
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from symaware_cli.studies.row import Row

_NAMES = r"[^()|\s][^()|]*?"
_FORM = re.compile(
    rf"\s*P\(\s*(?P<satisfied>{_NAMES})\s*(?:\|\s*(?P<given>{_NAMES})\s*)?\)\s*>\s*(?P<probability>\S+)\s*"
)

#: Claims beyond these limits need more runs than a sweep may have.
LIMITS = (0.0, 1.0 - 1e-6)


@dataclass(frozen=True, slots=True)
class ClaimTerm:
    """The claim that specifications are satisfied with a probability above a bound, possibly given others are.

    Attributes:
        satisfied: The names of the specifications; all of them must be satisfied.
        probability: The lower bound that the probability is claimed to exceed.
        given: The names of the specifications of the condition, all of which hold; empty without a condition.
    """

    satisfied: tuple[str, ...]
    probability: float
    given: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> ClaimTerm | None:
        """Parse a term; None if it does not have the form of one.

        Raises:
            ValueError: It has, but the bound is none, or a name is repeated; the message gives the reason.
        """
        match = _FORM.fullmatch(text)
        if match is None:
            return None
        satisfied, given = (
            re.split(r"\s+and\s+", found) if found else [] for found in match.group("satisfied", "given")
        )
        names = [*satisfied, *given]
        if any(len(name.split()) > 1 for name in names):
            raise ValueError("specifications are joined by `and`, such as P(sees and safe) > 0.9")
        repeated = next((name for number, name in enumerate(names) if name in names[:number]), None)
        if repeated is not None:
            raise ValueError(f"`{repeated}` is named twice in `{text.strip()}`")
        return cls(tuple(satisfied), number(match["probability"], "the probability", *LIMITS), tuple(given))

    def __str__(self) -> str:
        condition = f" | {' and '.join(self.given)}" if self.given else ""
        return f"P({' and '.join(self.satisfied)}{condition}) > {self.probability:.12g}"

    @property
    def names(self) -> Sequence[str]:
        """All specifications that it refers to."""
        return *self.satisfied, *self.given

    @property
    def is_plain(self) -> bool:
        """Whether it is about a single specification, without a condition."""
        return len(self.names) == 1

    @property
    def epsilon(self) -> float:
        """The upper bound claimed for the probability of failure, to 12 digits, so that 1 - 0.99 is 0.01."""
        return float(f"{1.0 - self.probability:.12g}")

    def outcome(self, row: Row) -> str | None:
        """Return the category in which a run is counted: ``satisfied``, or what counts against the claim.

        None if a run is not among those that the condition is about, because a specification of the condition is
        violated. A run that leaves the condition undecided, failed or was lost may have met it: it is counted, against
        the claim. The count of failures given the condition is then at least that with the unknown verdicts, and so is
        their share, because each run that is added is one.
        """
        if row.state != "done":
            return row.state
        conditions = [row.verdicts.get(name) for name in self.given]
        if "violated" in conditions:
            return None
        if any(each != "satisfied" for each in conditions):
            return "undecided"
        verdicts = [row.verdicts.get(name) or "undecided" for name in self.satisfied]
        if "violated" in verdicts:
            return "violated"
        return next((each for each in verdicts if each != "satisfied"), "satisfied")


def number(text: str, what: str, low: float, high: float) -> float:
    """Parse a number above a bound and at most another.

    Raises:
        ValueError: It is none.
    """
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{what} is a number, not `{text}`") from None
    if not low < value <= high:
        raise ValueError(f"{what} is more than {low:g} and at most {high:.9g}, not {value:g}")
    return value
