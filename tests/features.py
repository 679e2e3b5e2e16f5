"""The features that a test uses, so that copies without some of them run the tests of all others (`.ci/removals`).

PyBullet is one more: from Python 3.12 on it has no wheels, so the tests that need it are left out there.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
from checkout import CHECKOUT

import symaware_cli

#: The rooms that nothing below them imports.
FEATURES = frozenset(
    {
        "evidence",
        "studies",
        "views",
        "processes",
        "planning",
        "knowledge",
        "maps",
        "promises",
        "roads",
        "bags",
        "fmi",
        "worlds",
        "learning",
    }
)

#: The verbs that do without: what they import of a feature is for an option of it.
WHOLE = frozenset({"run", "validate", "inspect", "schema", "show"})

PACKAGE = CHECKOUT / "symaware_cli"
INSTALLED = Path(symaware_cli.__file__).parent


@cache
def missing() -> frozenset[str]:
    """The modules of the checkout that the installed copy does not have; a room that is missing stands for its own."""
    gone = [path.relative_to(PACKAGE).with_suffix("") for path in PACKAGE.rglob("*.py") if path.stem != "__init__"]
    gone = [path for path in gone if not (INSTALLED / path).with_suffix(".py").exists()]
    return frozenset(".".join(("symaware_cli", *path.parts)) for path in gone)


@cache
def words() -> re.Pattern[str] | None:
    """The names of missing modules, plugins, verbs and names of the public interface."""
    if not missing():
        return None
    found = {re.escape(module) for module in missing()}
    found |= {rf"symaware_cli\.{room}\b" for room in FEATURES if not (INSTALLED / room).exists()}
    points = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    for group, entries in points.items():
        for name, target in entries.items():
            module = target.partition(":")[0]
            if group == "symaware.commands":
                file = (CHECKOUT / module.replace(".", "/")).with_suffix(".py")
                if name not in WHOLE and _imports_missing(file.read_text(encoding="utf-8")):
                    found.add(rf'(?:symaware\(|command\(|COMMAND, )"{name}"')
            elif not _exists(module):
                # A name with a dot is of nothing else; one without counts where a scenario would use it.
                found.add(rf"(?<![\w.-]){re.escape(name)}(?![\w-])" if "." in name else rf'\buse"?: "?{name}\b(?![.])')
                if group == "symaware.sections":
                    found.add(rf"^\W*{name}\b\W*:")
                elif group == "symaware.environments":
                    found.add(rf'(?<!sys.modules, )"{name}"')
    for module, names in symaware_cli._HOMES.items():
        if not _exists(module):
            found |= {rf"\b(?:sa|symaware_cli)\.{name}\b" for name in names}
            found |= {rf"from symaware_cli import [^\n]*\b{name}\b" for name in names}
    return re.compile("|".join(sorted(found)), re.MULTILINE)


def _imports_missing(text: str) -> bool:
    named = {f"{node.module}" for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)}
    return not all(_exists(module) for module in named if module.startswith("symaware_cli."))


def _exists(module: str) -> bool:
    path = INSTALLED.parent.joinpath(*module.split("."))
    return path.with_suffix(".py").exists() or path.is_dir()


def uses_missing(text: str) -> bool:
    """Whether a text names something that is missing."""
    pattern = words()
    return pattern is not None and pattern.search(text) is not None


@cache
def module_uses_missing(path: Path) -> bool:
    """Whether a module of tests, or one of their own that it imports, names something that is missing."""
    text = path.read_text(encoding="utf-8")
    if uses_missing(text):
        return True
    return any(module_uses_missing(helper) for helper in _helpers(path, text))


def item_uses_missing(item: pytest.Item) -> bool:
    """Whether a test is about scenario files that name something that is missing."""
    _, files, reports = _subject(item)
    # Messages name the installed worlds that have what a scenario needs.
    worlds = missing_worlds()
    return any(map(uses_missing, files)) or any(f"`{world}`" in report for report in reports for world in worlds)


_NEEDS_PYBULLET = re.compile(r"pybullet|racecar|quadrotor|worlds\.(spatial|bullet|body_)")


@cache
def without_pybullet() -> bool:
    """Whether PyBullet is not installed."""
    return find_spec("pybullet") is None


@cache
def module_needs_pybullet(path: Path) -> bool:
    """Whether a module of tests, or one of their own that it imports, names PyBullet or what moves there alone."""
    text = path.read_text(encoding="utf-8")
    if _NEEDS_PYBULLET.search(text):
        return True
    return any(module_needs_pybullet(helper) for helper in _helpers(path, text))


def item_needs_pybullet(item: pytest.Item) -> bool:
    """Whether a test is about scenario files that name PyBullet or what moves there alone."""
    source, files, reports = _subject(item)
    return any(map(_NEEDS_PYBULLET.search, (source, item.nodeid, *files, *reports)))


def _helpers(path: Path, text: str) -> list[Path]:
    """The modules beside a module of tests, or in `tests`, that it imports."""
    named = {
        each for line in re.findall(r"^\s*(?:from (\w+) import|import (\w+))", text, re.MULTILINE) for each in line
    }
    helpers = [folder / f"{name}.py" for name in named if name for folder in (path.parent, CHECKOUT / "tests")]
    return [helper for helper in helpers if helper.is_file() and helper != path]


def _subject(item: pytest.Item) -> tuple[str, list[str], list[str]]:
    """The source of a test, and the texts of the scenario files that it names or is given, and of their reports."""
    function = getattr(item, "function", None)
    source = inspect.getsource(function) if function is not None else ""
    named = set(re.findall(r"[\w-]+\.(?:yaml|toml)", source))
    given = getattr(getattr(item, "callspec", None), "params", {}).values()
    named |= {str(each) for each in given if isinstance(each, str | Path)}
    named |= {f"{each}.yaml" for each in given if isinstance(each, str) and re.fullmatch(r"[\w-]+", each)}
    folders = (CHECKOUT / "scenarios", CHECKOUT / "tests" / "scenarios" / "bad")

    def texts(ending: str) -> list[str]:
        files = [folder / f"{name}{ending}" for name in named for folder in folders]
        return [file.read_text(encoding="utf-8", errors="replace") for file in files if os.path.isfile(file)]

    return source, texts(""), texts(".expected")


@cache
def missing_worlds() -> tuple[str, ...]:
    """The names of the worlds that the installed copy does not have."""
    points = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    worlds = points["symaware.environments"]
    return tuple(name for name, target in worlds.items() if not _exists(target.partition(":")[0]))
