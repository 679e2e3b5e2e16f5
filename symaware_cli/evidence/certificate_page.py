"""A certificate as a printable page, and as a part of other pages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symaware_cli.evidence.certificate import POST_HOC
from symaware_cli.evidence.signed_statement import fingerprint
from symaware_cli.views import rendered

#: The maximum number of combinations listed.
_MOST = 200


def page(statement: Mapping[str, Any], public_key: str | None) -> str:
    """Return the page as one HTML file.

    The same statement gives the same bytes, which lets `symaware verify` check the page.

    Args:
        statement: The statement.
        public_key: The raw public key of its signature, in hexadecimal; None if it is unsigned.
    """
    page = str(rendered("certificate.html", content=content(statement, public_key)))
    # Escaped as in pages of earlier versions; only quotation marks of the content are written like this.
    return page.replace("&#39;", "&#x27;").replace("&#34;", "&quot;")


def content(statement: Mapping[str, Any], public_key: str | None) -> dict[str, Any]:
    """Return the variables of the template.

    Raises:
        LookupError: The statement is incomplete or malformed; likewise TypeError, ValueError, AttributeError.
    """
    said = statement["predicate"]
    claim = said["claim"]
    is_post_hoc = claim["stated"] == POST_HOC
    formula = said["formula"]
    computed = ("symaware-cli", "Python", "numpy", "scipy")
    more = len(said["combinations"]) - _MOST
    return {
        "title": f"{'Post hoc' if is_post_hoc else 'Certificate'}: {claim['text']}",
        "heading": "Post hoc: not a certificate" if is_post_hoc else "Certificate",
        "is_post_hoc": is_post_hoc,
        "claim": claim["text"],
        "established": bool(said["established"]),
        "outcome": "established" if said["established"] else "not established for all combinations",
        "facts": {
            "stated": claim["stated"],
            **_specifications(claim, formula),
            "semantics": f"version {formula['semantics']}, SymAware {formula['symaware']}",
            "the probability is over": said["probability_over"],
            "decided by": said["method"],
            "error probability": f"at most {said['alpha']:g} in all, "
            f"{said['alpha_of_each_combination']:.3g} for each combination",
            "counted against it": "runs that violate the specification, leave it undecided, failed or were lost",
            "scenario": f"{said['sweep']['scenario']}; seed of the sweep {said['sweep']['seed']}",
            "rows": f"{said['rows']['count']:,}; root {said['rows']['root']}",
            "signature": f"Ed25519, key {public_key}, SHA-256 of it {fingerprint(public_key)}"
            if public_key
            else "none",
        },
        "header": ("combination", "runs", "against", "evidence", "needed", "established"),
        "rows": [row for each in said["combinations"][:_MOST] for row in _rows(each)],
        "more": f"{more:,}" if more > 0 else "",
        "versions": ", ".join(f"{name} {said['versions'][name]}" for name in computed if name in said["versions"]),
    }


def _specifications(claim: Mapping[str, Any], formula: Mapping[str, Any]) -> dict[str, str]:
    """Return the formulas that the claim is about."""
    if "terms" not in claim:
        return {"specification": _formula_text(claim["specification"], formula["specification"])}
    stated = [_formula_text(name, each) for name, each in formula["specifications"].items()]
    return {"specifications": "; ".join(stated)}


def decided(combination: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the terms that are decided in a combination: the text of each, empty for the only one, and its figures.

    The number of ``runs`` of a term with a condition is that of the runs that it counts.
    """
    if "terms" not in combination:
        return [("", combination)]
    return [(each["text"], {**each, "runs": each["counted"]}) for each in combination["terms"]]


def _rows(combination: Mapping[str, Any]) -> list[list[str]]:
    """Return the cells of a row for each term of a combination."""
    found = []
    for text, figures in decided(combination):
        name, *cells = _cells({**combination, **figures})
        found.append([f"{text}, {name}" if text else name, *cells])
    return found


def _cells(combination: Mapping[str, Any]) -> list[str]:
    names = [
        *([combination["variant"]] if combination["variant"] else []),
        *(f"{path} = {value}" for path, value in combination["parameters"].items()),
    ]
    return [
        ", ".join(names) or "as it is",
        f"{combination['runs']:,}",
        ", ".join(f"{count:,} {name}" for name, count in combination["against"].items() if count) or "0",
        f"{combination['evidence']:.4g}",
        f"{combination['needed']:.4g}",
        "yes" if combination["established"] else "no",
    ]


def _formula_text(name: str, specification: Any) -> str:
    if not isinstance(specification, Mapping):
        return f"{name}: {specification}"
    rest = ", ".join(f"{key} {value}" for key, value in specification.items() if key != "formula")
    return f"{name}: {specification.get('formula')}" + (f" ({rest})" if rest else "")
