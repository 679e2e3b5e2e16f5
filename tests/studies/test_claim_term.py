"""Claims with conditions and of several terms are wrong no more often than they say, on a model with known chances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from symaware_cli.studies import Claim, ClaimTerm, Row
from symaware_cli.studies.claim import ClaimProgress, runs_needed

#: The outcomes of a run of the model: its row, whether it truly sees and is safe, and its probability. Undecided runs
#: are what the claims may not profit from: here they truly see, and are unsafe.
MODEL = (
    ("satisfied", "satisfied", True, True, 0.80),
    ("satisfied", "violated", True, False, 0.03),
    ("undecided", "violated", True, False, 0.02),
    ("undecided", "undecided", True, False, 0.01),
    ("violated", "violated", False, False, 0.06),
    ("violated", "satisfied", False, True, 0.08),
)
CHANCES = np.array([each[-1] for each in MODEL])
SEES = math.fsum(each[-1] for each in MODEL if each[0] == "satisfied")
SAFE_GIVEN_SEES = 0.80 / math.fsum(each[-1] for each in MODEL if each[2])
BOTH = 0.80
REPEATS = 3000


def row(sees: str, safe: str, index: int = 0) -> Row:
    return Row(index, "done", {"sees": sees, "safe": safe})


@pytest.mark.parametrize(
    ("verdicts", "found"),
    [
        (("satisfied", "satisfied"), ("satisfied", "satisfied", "satisfied")),
        (("satisfied", "violated"), ("satisfied", "violated", "violated")),
        (("violated", "satisfied"), ("violated", None, "violated")),
        (("violated", "violated"), ("violated", None, "violated")),
        (("undecided", "satisfied"), ("undecided", "undecided", "undecided")),
        (("satisfied", "undecided"), ("satisfied", "undecided", "undecided")),
    ],
)
def test_an_undecided_condition_is_not_met_as_an_event_and_met_and_failed_as_a_condition(
    verdicts: tuple[str, str], found: tuple[str | None, ...]
) -> None:
    claim = Claim.parse("P(sees) > 0.9; P(safe | sees) > 0.9; P(sees and safe) > 0.8")
    assert tuple(term.outcome(row(*verdicts)) for term in claim.terms) == found
    assert {term.outcome(Row(0, "failed")) for term in claim.terms} == {"failed"}
    assert {term.outcome(Row(0, "lost")) for term in claim.terms} == {"lost"}


def test_terms_round_trip_through_text() -> None:
    text = "P(sees) > 0.9; P(safe and calm | sees) > 0.999 with confidence 0.95, sequential"
    claim = Claim.parse(text)
    assert str(claim) == text
    assert claim.terms[1] == ClaimTerm(("safe", "calm"), 0.999, ("sees",))
    assert claim.names == ("sees", "safe", "calm")
    assert claim.alpha(3) == pytest.approx(0.05 / 6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("P(safe | safe) > 0.9", "`safe` is named twice"),
        ("P(safe sees) > 0.9", "joined by `and`"),
        ("P(safe) > 0.9; P(sees)", "is written like"),
        ("P(safe | ) > 0.9", "is written like"),
        ("; ".join(["P(safe) > 0.9"] * 21), "at most 20 terms"),
    ],
)
def test_malformed_terms_are_rejected(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Claim.parse(text)


def test_a_condition_that_no_run_meets_gives_no_claim() -> None:
    for rule in ("fixed", "sequential"):
        progress = ClaimProgress(Claim.parse(f"P(safe | sees) > 0.9 with confidence 0.9, {rule}"), 1)
        for index in range(500):
            progress.add(index, row("violated", "satisfied", index))
        assert progress.counted == [0]
        assert progress.evidence == pytest.approx([1.0])
        assert not progress.is_established


def certified(claim: Claim, outcomes: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return whether each term is ever certified in sweeps of the model; shape (terms, sweeps).

    Args:
        claim: The claim.
        outcomes: The outcome of each run, as an index in `MODEL`; shape (sweeps, runs).
    """
    found = []
    for term in claim.terms:
        of = [term.outcome(row(sees, safe)) for sees, safe, *_ in MODEL]
        counted = np.array([each is not None for each in of])[outcomes].cumsum(axis=1)
        failed = np.array([each not in (None, "satisfied") for each in of])[outcomes].cumsum(axis=1)
        # The least number of runs with which each number of failures establishes the term.
        most = int(failed.max())
        needed = np.full(most + 1, outcomes.shape[1] + 1)
        for failures in range(most + 1):
            needed[failures] = runs_needed(claim._evidence, failures, term.epsilon, claim.alpha(1))
            if needed[failures] > outcomes.shape[1]:
                break
        is_enough = (counted > 0) & (counted >= needed[failed])
        found.append(is_enough.any(axis=1) if claim.rule == "sequential" else is_enough[:, -1])
    return np.array(found)


@pytest.mark.parametrize("rule", ["fixed", "sequential"])
def test_no_term_that_is_false_is_certified_more_often_than_claimed(rule: str) -> None:
    """Each bound is the least that is false, so an error is the certificate of any term."""
    alpha = 0.05
    claim = Claim.parse(
        f"P(sees) > {SEES + 0.03!r}; P(safe | sees) > {SAFE_GIVEN_SEES!r}; P(sees and safe) > {BOTH!r} "
        f"with confidence {1 - alpha}, {rule}"
    )
    random = np.random.default_rng(43)
    outcomes = random.choice(len(MODEL), size=(REPEATS, 400), p=CHANCES)
    errors = int(certified(claim, outcomes).any(axis=0).sum())
    assert errors <= binom.ppf(0.99, REPEATS, alpha)
    # Each term alone, at the full error probability: at the bound of the condition the test is nearly exact.
    for text in (f"P(safe | sees) > {SAFE_GIVEN_SEES!r}", f"P(sees and safe) > {BOTH!r}"):
        alone = Claim.parse(f"{text} with confidence {1 - alpha}, {rule}")
        wrong = int(certified(alone, outcomes).sum())
        assert 0 < wrong <= binom.ppf(0.99, REPEATS, alpha)


@pytest.mark.parametrize("rule", ["fixed", "sequential"])
def test_terms_that_are_true_are_certified(rule: str) -> None:
    claim = Claim.parse(f"P(sees) > 0.7; P(safe | sees) > 0.85 with confidence 0.95, {rule}")
    outcomes = np.random.default_rng(44).choice(len(MODEL), size=(200, 800), p=CHANCES)
    assert certified(claim, outcomes).all(axis=0).mean() > 0.9


def test_runs_without_a_verdict_would_be_certified_too_often_if_they_were_left_out() -> None:
    """The rule for undecided runs is needed: without it the claim at the bound is wrong in most sweeps."""
    outcomes = np.random.default_rng(45).choice(len(MODEL), size=(300, 3000), p=CHANCES)
    claim = Claim.parse(f"P(safe | sees) > {SAFE_GIVEN_SEES!r} with confidence 0.95, fixed")
    decided = np.array([each[0] == "satisfied" for each in MODEL])[outcomes].sum(axis=1)
    failed = np.array([each[0] == "satisfied" and each[1] == "violated" for each in MODEL])[outcomes].sum(axis=1)
    pairs = zip(failed.tolist(), decided.tolist(), strict=True)
    wrong = sum(claim.evidence(claim.terms[0], *each) >= 20.0 for each in pairs)
    assert wrong > 200
