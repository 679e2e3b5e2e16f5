"""A certificate as a page to print, and as a part of other pages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from symaware_cli.study.certificate import POST_HOC
from symaware_cli.study.signed_statement import fingerprint

STYLE = """\
body{font:15px/1.5 system-ui,sans-serif;color:#1d2430;max-width:60rem;margin:2rem auto;padding:0 1.5rem}
h1{font-size:1.7rem;margin:0 0 .2rem}h2{font-size:1.15rem;margin:1.8rem 0 .5rem}
table{border-collapse:collapse;width:100%;font-size:.92em}
th,td{text-align:left;vertical-align:top;padding:.3rem .8rem .3rem 0;border-bottom:1px solid #dde2ea}
th{color:#566072;font-weight:600;white-space:nowrap}
th:first-child{width:1%}code,pre{font:12.5px/1.45 ui-monospace,monospace;overflow-wrap:anywhere}
.claim{font-size:1.25rem;margin:.6rem 0}.yes{color:#136f3a}.no{color:#a3261d}.note{color:#566072}
@media print{body{margin:0;max-width:none}}
"""

#: The most combinations that are listed.
_MOST = 200


def page(statement: Mapping[str, Any], public_key: str | None) -> str:
    """Return the page: one file of HTML.

    Args:
        statement: The statement.
        public_key: What it is signed with, raw, in hexadecimal; None if it is not.
    """
    claim = statement["predicate"]["claim"]
    title = f"{'Post hoc' if claim['stated'] == POST_HOC else 'Certificate'}: {claim['text']}"
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head><body>{''.join(section(statement, public_key))}</body></html>\n"
    )


def section(statement: Mapping[str, Any], public_key: str | None) -> Iterator[str]:
    """Yield the content of the page."""
    said = statement["predicate"]
    claim = said["claim"]
    is_post_hoc = claim["stated"] == POST_HOC
    yield f"<h1>{'Post hoc: not a certificate' if is_post_hoc else 'Certificate'}</h1>"
    if is_post_hoc:
        yield '<p class="no">The claim was chosen after the runs were known. Its confidence does not hold.</p>'
    outcome, colour = ("established", "yes") if said["established"] else ("not established for all combinations", "no")
    yield f'<p class="claim">{escape(claim["text"])}: <b class="{colour}">{outcome}</b></p>'
    yield "<table>"
    formula = said["formula"]
    entries = {
        "stated": claim["stated"],
        "specification": _formula_text(claim["specification"], formula["specification"]),
        "semantics": f"version {formula['semantics']}, SymAware {formula['symaware']}",
        "the probability is over": said["probability_over"],
        "decided by": said["method"],
        "error probability": f"at most {said['alpha']:g} in all, "
        f"{said['alpha_of_each_combination']:.3g} for each combination",
        "counted against it": "runs that violate the specification, leave it undecided, failed or were lost",
        "scenario": f"{said['sweep']['scenario']}; seed of the sweep {said['sweep']['seed']}",
        "rows": f"{said['rows']['count']:,}; root {said['rows']['root']}",
        "signature": f"Ed25519, key {public_key}, SHA-256 of it {fingerprint(public_key)}" if public_key else "none",
    }
    for name, text in entries.items():
        yield f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>"
    yield "</table><h2>Combinations</h2><table><tr>"
    yield "".join(
        f"<th>{name}</th>" for name in ("combination", "runs", "against", "evidence", "needed", "established")
    )
    yield "</tr>"
    for each in said["combinations"][:_MOST]:
        names = [
            *([each["variant"]] if each["variant"] else []),
            *(f"{k} = {v}" for k, v in each["parameters"].items()),
        ]
        cells = [
            ", ".join(names) or "as it is",
            f"{each['runs']:,}",
            ", ".join(f"{count:,} {name}" for name, count in each["against"].items() if count) or "0",
            f"{each['evidence']:.4g}",
            f"{each['needed']:.4g}",
            "yes" if each["established"] else "no",
        ]
        yield f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
    yield "</table>"
    if len(said["combinations"]) > _MOST:
        yield f'<p class="note">and {len(said["combinations"]) - _MOST:,} more, in the JSON</p>'
    computed = ("symaware-cli", "Python", "numpy", "scipy")
    versions = [f"{name} {said['versions'][name]}" for name in computed if name in said["versions"]]
    yield f"<p class=note>Made with {escape(', '.join(versions))}; all versions are in the JSON. "
    yield "To check it: <code>symaware verify certificate.json</code> in the folder of the sweep.</p>"


def _formula_text(name: str, specification: Any) -> str:
    if not isinstance(specification, Mapping):
        return f"{name}: {specification}"
    rest = ", ".join(f"{key} {value}" for key, value in specification.items() if key != "formula")
    return f"{name}: {specification.get('formula')}" + (f" ({rest})" if rest else "")
