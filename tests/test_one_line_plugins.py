"""Drawings, exports and sections of reports are registered in pyproject.toml alone: no module names them."""

import ast
import importlib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import get_args

import pytest

from symaware_cli.cli.plugin_catalogue import every_plugin
from symaware_cli.evidence.report.report_section import SECTION
from symaware_cli.views.exporting.export_format import EXPORT
from symaware_cli.views.scene.drawing import DRAWING, Drawing, Output
from symaware_cli.views.scene.scene import installed_drawings
from symaware_cli.world.plugin_kind import PluginKind

TOP = Path(__file__).parents[1]
PACKAGE = TOP / "symaware_cli"
GROUPS: Mapping[str, Mapping[str, str]] = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]["entry-points"]
KINDS = [DRAWING, EXPORT, SECTION]


def names_in(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the imports of a file: the last part of the name of the module, and the name in it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield node.value.id, node.attr
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from ((node.module.rpartition(".")[2], alias.name) for alias in node.names)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_no_module_but_its_own_names_a_plugin(kind: PluginKind) -> None:
    targets = GROUPS[kind.group].values()
    own = {(module.rpartition(".")[2], name) for module, _, name in (target.partition(":") for target in targets)}
    assert own
    for file in PACKAGE.rglob("*.py"):
        assert own.isdisjoint(names_in(file)), file


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_class_of_a_kind_is_registered(kind: PluginKind) -> None:
    (base,) = kind.bases
    targets = GROUPS[kind.group].values()
    for target in targets:
        importlib.import_module(target.partition(":")[0])

    def derived(parent: type) -> Iterator[type]:
        children: list[type] = type.__subclasses__(parent)
        for each in children:
            yield each
            yield from derived(each)

    own = {each for each in derived(base) if each.__module__.startswith("symaware_cli")}
    concrete = {f"{each.__module__}:{each.__name__}" for each in own if not each.__name__.startswith("_")}
    abstract = {"symaware_cli.views.exporting.conversion:TableFormat"}
    assert concrete - abstract == set(targets)


def test_every_group_of_entry_points_is_listed() -> None:
    # Verbs are listed by the help.
    listed = {"symaware.commands", *(each.group for each in every_plugin().kinds.values())}
    assert {name for name in GROUPS if name.startswith("symaware.")} <= listed


def test_the_order_of_drawings_is_that_of_their_numbers_which_are_unique() -> None:
    found: dict[type[Drawing], float] = {}
    for output in get_args(Output):
        drawings = list(installed_drawings(output))
        assert [each.order for each in drawings] == sorted(each.order for each in drawings)
        found |= {each: each.order for each in drawings if each.__module__.startswith("symaware_cli.")}
    assert len({*found.values()}) == len(found) == len(GROUPS["symaware.drawings"])
    assert max(found.values()) < Drawing.order
