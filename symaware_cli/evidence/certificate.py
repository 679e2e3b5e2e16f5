"""The statement of a certificate: the claim, its probability space, the evidence, and data for checks.

The statement depends only on the folder of the sweep, so it can be regenerated and compared.

Reasons: docs/decisions/0058-evidence-that-agrees.md
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from symaware_cli.evidence.signed_statement import TYPE, canonical
from symaware_cli.specification.formula import SEMANTICS
from symaware_cli.studies import (
    IDENTITY,
    JOURNAL,
    SWEEP,
    CellStops,
    Claim,
    ClaimTerm,
    JournalRecord,
    SweepError,
    SweepFolder,
    SweepJournal,
    unknown_specification,
)
from symaware_cli.version import __version__

PREDICATE_TYPE = "urn:symaware:sweep-certificate:1"

#: The category of runs that do not meet the condition of a term.
_NOT_COUNTED = "not counted"

#: When a claim was stated.
BEFOREHAND, POST_HOC = "before the first run", "post hoc"

_METHODS = {
    "fixed": "one test at the planned number of runs: 1 / P(X <= failures), X binomial (runs, 1 - probability); "
    "equal to a one-sided interval of Clopper and Pearson",
    "sequential": "e-process after each run: likelihood ratio of Beta(1/2, 1/2) truncated to (0, epsilon) to epsilon, "
    "the probability of failing, epsilon = 1 - probability",
}
_HASH = "Merkle tree of RFC 6962 (SHA-256) over the rows in order of their index, each in canonical JSON (RFC 8785)"

#: Larger integers are written as text in canonical JSON, as RFC 7493 recommends.
_MOST_INTEGER = 2**53 - 1


def statement(folder: SweepFolder, post_hoc: Claim | None = None) -> dict[str, Any]:
    """Return the in-toto statement about the claim of a sweep, whether or not the claim is established.

    Args:
        folder: The folder of a finished sweep.
        post_hoc: A claim that is not in the plan; None for the claim of the plan.

    Raises:
        SweepError: The plan has no claim, the runs are not independent, or the sweep is unfinished.
    """
    plan, names = folder.plan, folder.specifications
    claim = post_hoc or plan.document.claimed
    if claim is None:
        raise SweepError(
            f"the plan of {folder.path} has no claim: `symaware sweep ... --with 'claim=P(NAME) > 0.99'` states one "
            "beforehand, and `certify --claim` evaluates one afterwards"
        )
    for name in claim.names:
        if name not in names:
            raise unknown_specification(name, names)
    if not plan.document.is_independent:
        raise SweepError(f"runs of the design `{plan.document.design}` are not independent: nothing can be certified")
    stops = CellStops(plan, names)
    counts = [[Counter[str]() for _ in claim.terms] for _ in plan.cells]
    with SweepJournal(folder.path / JOURNAL) as journal:
        for row in journal.rows():
            stops.add(row)
            for term, counted in zip(claim.terms, counts[plan.cell(row.index).number], strict=True):
                counted[term.outcome(row) or _NOT_COUNTED] += 1
        count = journal.counts().all
        leaves = _root_hash(map(leaf_of, journal.records()))
    if count != stops.planned:
        raise SweepError(
            f"{count:,} of {stops.planned:,} runs are made: `symaware resume {folder.path}` makes the others"
        )
    cells = [_of_cell(folder, claim, number, each) for number, each in enumerate(counts)]
    document = plan.document
    files = {name: (folder.path / name).read_bytes() for name in (SWEEP, IDENTITY)}
    files.update(folder.scenario_files())
    return {
        "_type": TYPE,
        "subject": [
            {"name": "rows", "digest": {"sha256": leaves.hex()}},
            *({"name": name, "digest": {"sha256": _sha256(content)}} for name, content in files.items()),
        ],
        "predicateType": PREDICATE_TYPE,
        "predicate": {
            "claim": {
                "text": str(claim),
                **_claimed(claim),
                "confidence": claim.confidence,
                "rule": claim.rule,
                "stated": POST_HOC if post_hoc else BEFOREHAND,
            },
            "established": all(each["established"] for each in cells),
            "probability_over": _probability_over(folder),
            "method": _METHODS[claim.rule] + _of_terms(claim),
            "alpha": claim.alpha(1) * len(claim.terms),
            "alpha_of_each_combination": claim.alpha(len(cells)),
            "combinations": cells,
            "formula": {**_formula(folder, claim), "semantics": SEMANTICS, "symaware": __version__},
            "sweep": {
                "scenario": folder.source.scenario.name,
                "seed": str(document.seed),
                "runs_of_each_combination": document.runs,
                "paired": document.paired,
            },
            "rows": {"count": count, "hash": _HASH, "root": leaves.hex()},
            "versions": dict(folder.identity.versions),
        },
    }


def leaves(folder: SweepFolder) -> Iterator[tuple[int, str]]:
    """Yield the index of each row and its leaf hash, in hexadecimal."""
    with SweepJournal(folder.path / JOURNAL) as journal:
        for record in journal.records():
            yield record.index, leaf_of(record).hex()


def leaf_of(record: JournalRecord) -> bytes:
    """Return the leaf hash of a row: of all its columns in the table, without wall time and log."""
    texts = ("parameters", "verdicts", "robustness", "metrics")
    fields = record._asdict()
    content = {name: json.loads(each) if name in texts else each for name, each in fields.items()}
    content["seed"] = str(record.seed)
    return _leaf_hash(canonical(_plain(content)))


def _claimed(claim: Claim) -> dict[str, Any]:
    """Return the claim as plain data."""
    if claim.is_plain:
        return {"specification": claim.terms[0].satisfied[0], "probability": claim.terms[0].probability}
    return {
        "terms": [
            {"satisfied": [*each.satisfied], "given": [*each.given], "probability": each.probability}
            for each in claim.terms
        ]
    }


def _of_terms(claim: Claim) -> str:
    """Return how terms are decided, beyond a single probability."""
    said = ""
    if any(term.given for term in claim.terms):
        said += "; given the condition, only the runs that meet it or leave it undecided are counted, and the latter "
        said += "against the claim"
    if len(claim.terms) > 1:
        said += "; all terms that are certified hold jointly (Bonferroni)"
    return said


def _of_cell(folder: SweepFolder, claim: Claim, number: int, counts: Sequence[Counter[str]]) -> dict[str, Any]:
    cell, cells = folder.plan.cells[number], len(folder.plan.cells)
    terms = [_of_term(claim, *each, cells) for each in zip(claim.terms, counts, strict=True)]
    found: dict[str, Any] = {
        "parameters": _plain(cell.parameters),
        "variant": cell.variant,
        "scenario": folder.identity.cells[number],
        "runs": counts[0].total(),
    }
    if claim.is_plain:
        return {**found, **terms[0]}
    for term, each, counted in zip(claim.terms, terms, counts, strict=True):
        each |= {"text": str(term), "counted": counted.total() - counted[_NOT_COUNTED]}
    return {**found, "terms": terms, "established": all(each["established"] for each in terms)}


def _of_term(claim: Claim, term: ClaimTerm, counts: Counter[str], cells: int) -> dict[str, Any]:
    """Return the figures of a term in a combination."""
    runs = counts.total() - counts[_NOT_COUNTED]
    failures = runs - counts["satisfied"]
    evidence = claim.evidence(term, failures, runs)
    return {
        "satisfied": counts["satisfied"],
        "against": {name: counts[name] for name in ("violated", "undecided", "failed", "lost")},
        # Rounded, so that other implementations of the beta function give the same value.
        "evidence": float(f"{min(evidence, 1e300):.9g}"),
        "needed": float(f"{1.0 / claim.alpha(cells):.9g}"),
        "runs_needed": claim.runs_needed(term, failures, cells),
        "established": evidence >= 1.0 / claim.alpha(cells),
    }


def _probability_over(folder: SweepFolder) -> str:
    document = folder.plan.document
    drawn = [f"{path} from {json.dumps(each.model_dump(exclude_unset=True))}" for path, each in document.drawn.items()]
    said = (
        f"independent runs, each with a seed of its own derived from the seed {document.seed} of the sweep, from which "
        "all noise and all random initial values of the scenario are drawn"
    )
    if drawn:
        said += f"; and the values {', '.join(drawn)}, drawn independently in each run"
    if len(folder.plan.cells) > 1:
        said += "; the claim is made for each combination, and holds for all that are certified jointly (Bonferroni)"
    return said


def _formula(folder: SweepFolder, claim: Claim) -> dict[str, Any]:
    """Return the specifications as stated in the resolved scenario of the first combination."""
    found = {name: _plain(_stated(folder, name)) for name in claim.names}
    return {"specification": found[claim.names[0]]} if claim.is_plain else {"specifications": found}


def _stated(folder: SweepFolder, name: str) -> Any:
    """Return a specification or contract as stated in the resolved scenario; None if it is elsewhere."""
    for section in ("specifications", "contracts"):
        stated = folder.identity.resolved.get(section)
        if isinstance(stated, Mapping) and name in stated:
            return stated[name]
    return None


def _plain(value: Any) -> Any:
    """Convert values that JSON cannot represent exactly to text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if value != value else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, int) and abs(value) > _MOST_INTEGER:
        return str(value)
    return value


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _leaf_hash(content: bytes) -> bytes:
    """Return the hash of a leaf of the Merkle tree of RFC 6962, section 2.1."""
    return hashlib.sha256(b"\0" + content).digest()


def _root_hash(leaves: Iterable[bytes]) -> bytes:
    """Return the root hash of the tree over its leaf hashes, in memory proportional to its depth."""
    # Complete subtrees from left to right, each larger than the next, as (height, hash).
    subtrees: list[tuple[int, bytes]] = []
    for each in leaves:
        height, node = 0, each
        while subtrees and subtrees[-1][0] == height:
            node = _inner(subtrees.pop()[1], node)
            height += 1
        subtrees.append((height, node))
    if not subtrees:
        return hashlib.sha256().digest()
    _, node = subtrees.pop()
    while subtrees:
        node = _inner(subtrees.pop()[1], node)
    return node


def _inner(left: bytes, right: bytes) -> bytes:
    return hashlib.sha256(b"\1" + left + right).digest()
