"""The product of the claims of several sweeps of one scenario: a joint probability from conditional ones.

Reasons: docs/decisions/0119-products-of-claims.md
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from symaware_cli.evidence.certificate import statement
from symaware_cli.evidence.sweep_verification import require_sound
from symaware_cli.language import FilePath
from symaware_cli.studies import Claim, ClaimTerm, SweepError, SweepFolder, differences, listed, require_pyarrow


@dataclass(frozen=True, slots=True)
class ClaimFactor:
    """A claim of one sweep, as a factor of a product.

    Attributes:
        folder: The folder of the sweep.
        term: The probability that is claimed.
        confidence: The confidence of the claim.
        rows: The root hash of the rows that decide it.
        is_established: Whether they establish it.
    """

    folder: Path
    term: ClaimTerm
    confidence: float
    rows: str
    is_established: bool

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {**asdict(self), "folder": str(self.folder), "term": str(self.term)}


@dataclass(frozen=True, slots=True)
class ClaimProduct:
    """The claim that specifications are satisfied together, as the product of claims.

    Attributes:
        satisfied: The names of the specifications, in the order of the factors.
        factors: The claims; the condition of each is that all specifications before it are satisfied.
    """

    satisfied: Sequence[str]
    factors: Sequence[ClaimFactor]

    @property
    def probability(self) -> float:
        """The product of the bounds, which the joint probability exceeds."""
        return math.prod(each.term.probability for each in self.factors)

    @property
    def confidence(self) -> float:
        """The confidence in all factors jointly: 1 minus the sum of their error probabilities."""
        return 1.0 - math.fsum(1.0 - each.confidence for each in self.factors)

    @property
    def is_established(self) -> bool:
        """Whether all factors are established."""
        return all(each.is_established for each in self.factors)

    def __str__(self) -> str:
        return f"P({' and '.join(self.satisfied)}) > {self.probability:.9g} with confidence {self.confidence:.9g}"

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "claim": str(self),
            "satisfied": [*self.satisfied],
            "probability": self.probability,
            "confidence": self.confidence,
            "established": self.is_established,
            "factors": [each.to_json() for each in self.factors],
        }


def certify_product(folders: Sequence[FilePath]) -> ClaimProduct:
    """Decide the product of the claims of several sweeps, such as P(sees) and P(safe | sees).

    P(A and B) = P(A) P(B | A). Each claim is of one term, stated before the first run. The condition of a claim is that
    all specifications of the claims before it are satisfied, and the first one has none. A run that leaves the
    condition undecided counts against the claim, so the bound holds regardless of its verdict.

    The sweeps have the same scenario, the same distributions of drawn values and the same versions of software, which
    is checked by their digests, and they have no run in common.

    Args:
        folders: The folders of the finished sweeps, in the order of the factors; at least two.

    Raises:
        SweepError: A sweep does not exist, has no claim, is unfinished or contradicts itself, or the claims have no
            product.
    """
    require_pyarrow()
    if len(folders) < 2:
        raise SweepError("a product needs the claims of at least two sweeps")
    sweeps = [SweepFolder.opened(each) for each in folders]
    factors = [_factor(each) for each in sweeps]
    satisfied: list[str] = []
    for number, each in enumerate(factors):
        _require_condition(each, satisfied, factors[:number])
        satisfied += each.term.satisfied
    for number, sweep in enumerate(sweeps[1:], 1):
        _require_same_distribution(sweeps[0], sweep)
        for other in sweeps[:number]:
            shared = next(iter(_seeds(other) & _seeds(sweep)), None)
            if shared is not None:
                raise SweepError(
                    f"{other.path} and {sweep.path} have a run with the same seed, {shared}: give one of them another "
                    "`--seed`, as a product needs independent runs"
                )
    return ClaimProduct(satisfied, factors)


def _factor(sweep: SweepFolder) -> ClaimFactor:
    """Decide the claim of a sweep.

    Raises:
        SweepError: It has none, or more than one term or combination, or contradicts itself.
    """
    predicate = statement(sweep)["predicate"]
    claim = sweep.plan.document.claimed
    assert isinstance(claim, Claim)  # or there is no statement
    if len(claim.terms) > 1:
        raise SweepError(f"the claim of {sweep.path} has {len(claim.terms)} terms, and a factor has one")
    if len(predicate["combinations"]) > 1:
        raise SweepError(f"{sweep.path} has {len(predicate['combinations'])} combinations, and a factor has one")
    require_sound(sweep)
    rows = str(predicate["rows"]["root"])
    return ClaimFactor(sweep.path, claim.terms[0], claim.confidence, rows, bool(predicate["established"]))


def _require_condition(factor: ClaimFactor, satisfied: Sequence[str], before: Sequence[ClaimFactor]) -> None:
    """Raise an error if the condition of a factor is not that all specifications before it are satisfied."""
    repeated = next((each for each in factor.term.satisfied if each in satisfied), None)
    if repeated is not None:
        raise SweepError(f"`{repeated}` is claimed twice, again by {factor.folder}: each factor has its own")
    if {*factor.term.given} == {*satisfied}:
        return
    named = " and ".join(factor.term.satisfied)
    wanted = f"P({named} | {' and '.join(satisfied)})" if satisfied else f"P({named})"
    place = f"after {', '.join(str(each.folder) for each in before)}" if before else "as the first factor"
    said = f"{factor.folder} claims {factor.term}, which does not fit {place}"
    raise SweepError(f"{said}: a claim there is of {wanted}")


def _require_same_distribution(one: SweepFolder, other: SweepFolder) -> None:
    """Raise an error if the runs of two sweeps are not drawn from the same distribution."""
    lines = list(_differences(one, other))
    if lines:
        raise SweepError(listed(f"runs of {one.path} and {other.path} are not drawn from the same distribution", lines))


def _differences(one: SweepFolder, other: SweepFolder) -> Iterator[str]:
    yield from differences(
        one.identity, other.identity, (f"in {one.path}", f"in {other.path}"), "their scenarios differ:"
    )
    drawn, others = one.plan.document.drawn, other.plan.document.drawn
    for path in sorted({*drawn, *others}):
        if drawn.get(path) != others.get(path):
            yield f"{path} is {'drawn differently' if path in drawn and path in others else 'drawn in one of them'}"


def _seeds(sweep: SweepFolder) -> set[int]:
    return {sweep.plan.seed(index) for index in range(sweep.plan.count)}
