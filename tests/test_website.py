"""The site is made of the documents as they are: links lead to pages of the site, and every page can be found."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
from checkout import CHECKOUT

INDEX = CHECKOUT / "docs" / "index.md"


@pytest.fixture
def pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.syspath_prepend(str(CHECKOUT / "docs" / "website"))
    before = set(sys.modules)
    from pages import Pages

    found = Pages(CHECKOUT, tmp_path / "source")
    found.find()
    found.places[PurePosixPath("scenarios/hello.yaml")] = PurePosixPath("gallery/hello.md")
    yield found
    for name in {"pages"} - before:
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("link", "on_site"),
    [
        ("[a](scenario.md#regions)", "[a](scenario.md#regions)"),
        ("[a](../README.md)", "[a](../index.md)"),
        ("[a](../scenarios/hello.yaml)", "[a](../gallery/hello.md)"),
        ("[a](decisions)", "[a](decisions/README.md)"),
        ("[a](notebooks/first-scenario.ipynb)", "[a](notebooks/first-scenario.md)"),
        ("[a](../sweeps)", "a"),
        ("[a](https://example.org/x)", "[a](https://example.org/x)"),
        ("```text\n[a](../README.md)\n```", "```text\n[a](../README.md)\n```"),
    ],
)
def test_a_link_of_a_document_leads_to_the_page_on_the_site(pages: Any, link: str, on_site: str) -> None:
    assert pages.linked(link, PurePosixPath("docs/page.md")) == on_site


def test_a_link_to_a_file_that_is_no_page_leads_to_a_copy(pages: Any) -> None:
    assert pages.linked("[a](../LICENSE)", PurePosixPath("docs/page.md")) == "[a](../LICENSE)"
    assert (pages.target / "LICENSE").read_bytes() == (CHECKOUT / "LICENSE").read_bytes()


def test_the_contents_list_tutorials_in_order_before_all_else() -> None:
    text = INDEX.read_text(encoding="utf-8")
    first = re.findall(r"(?m)^\d+\. \[.*?\]\((.*?)\)", text)
    assert first[0] == "tutorials/first-scenario.md"
    assert {f"tutorials/{path.name}" for path in (CHECKOUT / "docs" / "tutorials").glob("*.md")} <= {*first}
    assert text.index("## Tutorials") == text.index("## ")
