"""Builds the site from the documents of the checkout: python docs/website/build.py [FOLDER].

The documents are copied into a temporary folder, with pages for every scenario and for the Python API, and Sphinx
makes pages of HTML from them. It needs the extra `site`, and no network. Any warning is an error, such as a link that
leads nowhere.

Reasons: docs/decisions/0105-site.md
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import gallery
import reference
from pages import Pages
from sphinx.cmd.build import build_main

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]

#: The page that lists all others.
CONTENTS = PurePosixPath("docs/index.md")

#: The first page.
FRONT = "index.md"

#: Where pages are that `CONTENTS` does not list.
REMAINDER = "More"


def main(arguments: list[str] | None = None) -> int:
    """Build the site, and return the exit status of Sphinx."""
    parser = argparse.ArgumentParser(description="Build the site.")
    parser.add_argument("folder", nargs="?", type=Path, default=CHECKOUT / "_site", help="by default _site")
    parser.add_argument("--quick", action="store_true", help="leave out the pictures of the gallery")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="keep logs of the scenarios, and use those there")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "source")
        logs = None if options.quick else options.logs or Path(folder, "logs")
        stage(CHECKOUT, source, logs)
        output = Path(folder, "site")
        quiet = ["--quiet", "--nitpicky", "--fail-on-warning", "--keep-going", "--jobs", "auto"]
        status = build_main([*quiet, "-c", str(HERE), "-d", str(Path(folder, "doctrees")), str(source), str(output)])
        if status:
            return status
        # Not a part of the site: it has the places of this build.
        shutil.rmtree(output / ".doctrees", ignore_errors=True)
        (output / ".buildinfo").unlink(missing_ok=True)
        shutil.rmtree(options.folder, ignore_errors=True)
        shutil.copytree(output, options.folder)
    print(f"{options.folder / 'index.html'}")
    return 0


def stage(checkout: Path, target: Path, logs: Path | None) -> None:
    """Write the sources of the site.

    Args:
        checkout: The top folder of the checkout.
        target: The folder of the sources, which is made.
        logs: The folder of the logs for the gallery; None for a gallery without pictures.
    """
    pages = Pages(checkout, target)
    pages.find()
    for scenario in gallery.scenarios(checkout):
        pages.places[scenario] = gallery.page(scenario)
    pages.places[PurePosixPath("scenarios")] = PurePosixPath("gallery/index.md")
    pages.write()
    gallery.write(pages, logs)
    reference.write(pages)
    shutil.copytree(HERE / "_static", target / "_static")
    _add(target / FRONT, contents(pages))


def _add(page: Path, text: str) -> None:
    page.write_text(f"{page.read_text(encoding='utf-8')}\n{text}", encoding="utf-8")


def tree(caption: str, entries: Sequence[str]) -> str:
    """Return a branch of the navigation, in the syntax of MyST; nothing if it has no entries."""
    if not entries:
        return ""
    return "\n".join(
        [
            "```{toctree}",
            ":hidden:",
            ":maxdepth: 1",
            *([f":caption: {caption}"] if caption else []),
            "",
            *entries,
            "```\n",
        ]
    )


def contents(pages: Pages) -> str:
    """Return the tree of all pages for the navigation: a branch for each heading of the contents.

    Pages that are not listed are added at the end, so that a new page is found before somebody has chosen its place.
    """
    text = (pages.target / CONTENTS).read_text(encoding="utf-8")
    branches: dict[str, list[str]] = {"": [str(CONTENTS), "gallery/index", "api/index"]}
    for heading, body in re.findall(r"(?ms)^## (.*?)\n(.*?)(?=^## |\Z)", text):
        # Each list entry begins with the link to its page.
        found = re.findall(r"(?m)^(?:-|\d+\.) \[(.*?)\]\(([^)#]*)", body)
        branches[heading] = [f"{title} <{_absolute(target)}>" for title, target in found]
    listed = {target for entries in branches.values() for target in re.findall(r"<(.*)>", "\n".join(entries))}
    known = {*listed, FRONT, str(CONTENTS)}
    places = sorted(str(place) for place in pages.places.values() if pages.is_in_navigation(place))
    branches[REMAINDER] = [place for place in places if place not in known]
    return "\n".join(tree(heading, entries) for heading, entries in branches.items())


def _absolute(target: str) -> str:
    """Return a link from the contents as one from the top folder of the sources."""
    parts: list[str] = list(CONTENTS.parent.parts)
    for part in PurePosixPath(target).parts:
        if part == "..":
            parts.pop()
        else:
            parts.append(part)
    return "/".join(parts)


if __name__ == "__main__":
    sys.exit(main())
