"""Nothing that a page shows becomes markup, whatever a log, a file or a plugin says."""

from dataclasses import fields, replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, get_args

import pytest
from mcap.writer import Writer

import symaware_cli as sa
from symaware_cli.api.report import TextReport
from symaware_cli.evidence.certificate_page import page as certificate_page
from symaware_cli.views.embedded_viewer import EmbeddedViewer
from symaware_cli.views.pages.block import (
    Block,
    CertificateBlock,
    CodeLines,
    DataTable,
    FactTable,
    Fold,
    Inline,
    MotionMap,
    Paragraph,
    Picture,
    ReplayFrame,
    SourceText,
)
from symaware_cli.views.pages.page_template import rendered

#: What would be markup, an attribute, or the end of a script.
HOSTILE = "\"'><img src=x onerror=alert(1)></script><script>alert(2)</script>`code`{{ 7 * 7 }} # '\"key: &amp;"

CERTIFICATE: dict[str, Any] = {
    **dict.fromkeys(("title", "heading", "claim", "outcome", "more", "versions"), HOSTILE),
    "is_post_hoc": True,
    "established": True,
    "facts": {HOSTILE: HOSTILE},
    "header": [HOSTILE],
    "rows": [[HOSTILE]],
}

BLOCKS: list[Block] = [
    FactTable({HOSTILE: HOSTILE}),
    DataTable((HOSTILE,), [(HOSTILE,), *((Inline(HOSTILE, look),) for look in ("code", "prose", "verdict"))]),
    Paragraph((HOSTILE, Inline(HOSTILE, "prose")), "note"),
    CodeLines(HOSTILE),
    SourceText(f"{HOSTILE}\nname: {HOSTILE}\n'{HOSTILE}'\n# {HOSTILE}"),
    Fold(HOSTILE, [CodeLines(HOSTILE)]),
    Picture(HOSTILE.encode(), "svg+xml", HOSTILE),
    MotionMap({"marks": [{"time": 0.5, "text": HOSTILE}], "agents": [{"name": HOSTILE}], HOSTILE: 1}),
    ReplayFrame(EmbeddedViewer(HOSTILE, {HOSTILE: HOSTILE}, "")),
    CertificateBlock(CERTIFICATE),
]


class Content(HTMLParser):
    """The elements, the texts and the scripts of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def require_tame(self) -> None:
        for tag, attributes in self.elements:
            assert not [name for name in attributes if name.startswith("on")]
            assert tag != "img" or str(attributes["src"]).startswith("data:image/")
        assert not [text for text in self.texts if text.strip() in ("alert(1)", "alert(2)")]


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: type(block).__name__)
def test_a_text_in_a_block_is_a_text(block: Block) -> None:
    page = rendered("section.html", heading=HOSTILE, blocks=[block], on_paper=False)
    content = Content(page)
    content.require_tame()
    tame = rendered("section.html", heading="", blocks=[_tame(block)], on_paper=False)
    # It has the elements that it has with a harmless text, and the heading.
    kinds = [tag for tag, _ in content.elements if tag not in ("code", "span", "h2")]
    assert kinds == [tag for tag, _ in Content(tame).elements if tag not in ("code", "span", "h2")]
    assert HOSTILE in content.texts


def _tame(block: Any) -> Any:
    if isinstance(block, str):
        return block.replace(HOSTILE, "harmless")
    if isinstance(block, dict):
        return {_tame(key): _tame(value) for key, value in block.items()}
    if isinstance(block, list | tuple):
        return type(block)(_tame(each) for each in block)
    if hasattr(block, "__dataclass_fields__"):
        return replace(block, **{field.name: _tame(getattr(block, field.name)) for field in fields(block)})
    return block


def test_every_kind_of_block_is_tried_with_a_hostile_text() -> None:
    assert {type(block) for block in BLOCKS} == {*get_args(Block)}


def test_a_log_by_another_program_cannot_add_markup(tmp_path: Path) -> None:
    path = tmp_path / f"{HOSTILE.replace('/', '')}.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(HOSTILE, "jsonschema", b"{}")
        writer.add_message(writer.register_channel(HOSTILE, "json", schema), 0, b"{}", 0)
        writer.finish()  # type: ignore[no-untyped-call] # mcap has no types for it
    content = Content(sa.write_report(path, tmp_path / "page.html").read_text(encoding="utf-8"))
    content.require_tame()
    assert HOSTILE in content.texts
    assert path.name in content.texts


def test_a_scenario_cannot_add_markup(tmp_path: Path) -> None:
    scenario = tmp_path / "tiny.yaml"
    scenario.write_text(
        f"# {HOSTILE}\nsymaware: 1\nname: tiny\nrun: {{duration: 0.2}}\n"
        "environment: {use: kinematic, with: {time_step: 0.1}}\n"
        "agents: {robot: {model: {use: single-integrator}, knowledge: {goal: [1, 0]}, components: {}}}\n",
        encoding="utf-8",
    )
    log = tmp_path / f"{HOSTILE.replace('/', '')}.mcap"
    sa.load(scenario).run(output=log)
    content = Content(sa.write_report(log, tmp_path / "page.html").read_text(encoding="utf-8"))
    content.require_tame()
    assert f"# {HOSTILE}" in content.texts


def test_a_summary_in_a_notebook_cannot_add_markup() -> None:
    content = Content(TextReport(HOSTILE, [(HOSTILE, HOSTILE)]).html)
    content.require_tame()
    assert content.texts == [HOSTILE] * 3


def test_the_page_of_a_certificate_has_the_bytes_of_earlier_versions() -> None:
    claim = f"P(safe) > 0.9, {HOSTILE}"
    said = {
        "claim": {"stated": "before the first run", "text": claim, "specification": 'it\'s "safe"'},
        "formula": {"semantics": 2, "symaware": "0.1.0", "specification": {"formula": "a < b & c", "each": "robot"}},
        "established": False,
        "probability_over": "runs",
        "method": "a test",
        "alpha": 0.01,
        "alpha_of_each_combination": 0.005,
        "sweep": {"scenario": "s.yaml", "seed": 3},
        "rows": {"count": 1200, "root": "ab"},
        "combinations": [
            {
                "variant": "<b>",
                "parameters": {"x": 1},
                "runs": 1200,
                "against": {"violated": 2},
                "evidence": 3.0,
                "needed": 200.0,
                "established": False,
            }
        ],
        "versions": {"symaware-cli": "0.1.0", "Python": "3.11"},
    }
    page = certificate_page({"predicate": said}, None)
    # As `html.escape` writes a text: verify compares the page beside a certificate with this one.
    assert f"<title>Certificate: {escape(claim)}</title>" in page
    facts = [
        ("stated", "before the first run"),
        ("specification", 'it\'s "safe": a < b & c (each robot)'),
        ("semantics", "version 2, SymAware 0.1.0"),
        ("the probability is over", "runs"),
        ("decided by", "a test"),
        ("error probability", "at most 0.01 in all, 0.005 for each combination"),
        ("counted against it", "runs that violate the specification, leave it undecided, failed or were lost"),
        ("scenario", "s.yaml; seed of the sweep 3"),
        ("rows", "1,200; root ab"),
        ("signature", "none"),
    ]
    header = ("combination", "runs", "against", "evidence", "needed", "established")
    cells = ("<b>, x = 1", "1,200", "2 violated", "3", "200", "no")
    body = (
        f'<h1>Certificate</h1><p class="claim">{escape(claim)}: <b class="no">not established for all combinations</b>'
        f"</p><table>{''.join(f'<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>' for name, text in facts)}"
        f"</table><h2>Combinations</h2><table><tr>{''.join(f'<th>{name}</th>' for name in header)}</tr>"
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr></table>"
        "<p class=note>Made with symaware-cli 0.1.0, Python 3.11; all versions are in the JSON. To check it: "
        "<code>symaware verify certificate.json</code> in the folder of the sweep.</p></body></html>\n"
    )
    assert page.endswith(f"</style></head><body>{body}")
