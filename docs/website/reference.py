"""The reference of the public Python API, from its docstrings."""

from __future__ import annotations

import inspect
from pathlib import PurePosixPath
from typing import Any

from pages import Pages

import symaware_cli

#: The pages of the reference: their file, their heading, and the rooms of the package whose public names they have.
#: The last one has what no other has.
_CHAPTERS = (
    ("runs", "Scenarios, runs and sweeps", ("api", "studies", "language", "processor")),
    ("logs", "Logs", ("log",)),
    ("evidence", "Evidence", ("evidence",)),
    ("learning", "Learning", ("learning",)),
    ("knowledge", "Knowledge", ("knowledge",)),
    ("processes", "Several processes", ("processes",)),
    ("plugins", "For plugins", ()),
)

#: What a class has from its bases and from Python is not repeated.
_OPTIONS = {"class": ("members", "show-inheritance"), "exception": ("members", "show-inheritance"), "function": ()}


def write(pages: Pages) -> None:
    """Write a page for each chapter, and their overview."""
    chapters: dict[str, list[str]] = {file: [] for file, _, _ in _CHAPTERS}
    for name in symaware_cli.__all__:
        chapters[_chapter(getattr(symaware_cli, name))].append(name)
    for file, heading, _ in _CHAPTERS:
        parts = [f"{heading}\n{'=' * len(heading)}", "All names are imported from ``symaware_cli``."]
        parts.append(".. currentmodule:: symaware_cli")
        # Functions first: they are where a reader begins.
        parts += sorted((_directive(name) for name in chapters[file]), key=lambda text: "autofunction" not in text)
        pages.put(PurePosixPath("api", f"{file}.rst"), "\n\n".join(parts) + "\n")
    testing = "Checks of plugins\n=================\n\n.. automodule:: symaware_cli.testing\n   :members:\n"
    pages.put(PurePosixPath("api/testing.rst"), testing + "   :imported-members:\n")
    listed = "\n".join([*(file for file, _, _ in _CHAPTERS), "testing"])
    about = "The public names of `symaware_cli`, and of `symaware_cli.testing` for plugins, from their docstrings."
    pages.put(PurePosixPath("api/index.md"), f"# Python API\n\n{about}\n\n```{{toctree}}\n\n{listed}\n```\n")


def _chapter(thing: Any) -> str:
    room = (thing.__module__ or "").removeprefix("symaware_cli.").partition(".")[0]
    return next((file for file, _, rooms in _CHAPTERS if room in rooms), _CHAPTERS[-1][0])


def _directive(name: str) -> str:
    thing = getattr(symaware_cli, name)
    kind = "function"
    if inspect.isclass(thing):
        kind = "exception" if issubclass(thing, BaseException) else "class"
    elif not inspect.isroutine(thing):
        kind = "data"
    options = "".join(f"\n   :{option}:" for option in _OPTIONS.get(kind, ()))
    return f".. auto{kind}:: {name}{options}"
