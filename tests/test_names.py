"""Each module and public class has a unique name, except for those listed here with a reason."""

import ast
from collections import defaultdict
from pathlib import Path

import symaware_cli

PACKAGE = Path(symaware_cli.__file__).parent

CLASSES = {
    "Parameters": "the parameters of each plugin, under `with` in a scenario: a nested class of the plugin",
    "Clock": "the simulated time of a run; the instants of a formula that is evaluated step by step",
    "Constant": "a truth value in the syntax tree, and in the formula compiled from it",
    "Not": "a negation in the syntax tree, and in the formula compiled from it",
}

VERB = "a command of the terminal, and the module that implements it"
BACKEND = "the display of one kind of marks, in each backend"

MODULES = {
    "bodies": BACKEND,
    "columns": BACKEND,
    "curves": BACKEND,
    "figure": "the articulated bodies that a log describes; the matplotlib figure of a plot",
    "output": "a file that is written completely or not at all; the output of each backend",
    "plot": VERB,
    "region": "a region of the plane; its use in specifications",
    "request": "the component that requests knowledge from other agents; the options of a plot; those of a sweep",
    "run": VERB,
    "scenery": "the obstacles of a world, and their display",
    "scope": "the values of names in expressions: of conditions, and of specifications",
    "show": VERB,
    "spatial": "worlds in space; topologies that depend on positions: installed entry points refer to both",
    "specifications": "their definitions in a scenario, their monitoring in a run, and their records in the log",
    "time": "simulated time in nanoseconds; the panels of a plot over time",
}


def modules() -> dict[str, list[str]]:
    found = defaultdict(list)
    for file in sorted(PACKAGE.rglob("*.py")):
        if file.stem not in ("__init__", "__main__"):
            found[file.stem].append(str(file.relative_to(PACKAGE)))
    return found


def public_classes() -> dict[str, list[str]]:
    found = defaultdict(list)
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(f"{file.relative_to(PACKAGE)}:{node.lineno}")
    return found


def shared(names: dict[str, list[str]]) -> dict[str, list[str]]:
    return {name: places for name, places in names.items() if len(places) > 1}


def test_no_two_public_classes_share_a_name() -> None:
    found = shared(public_classes())
    assert "Parameters" in found, "classes are found"
    assert {name: places for name, places in found.items() if name not in CLASSES} == {}
    assert sorted(set(CLASSES) - set(found)) == [], "a name that nobody shares needs no reason"


def test_no_two_modules_share_a_name() -> None:
    found = shared(modules())
    assert {name: places for name, places in found.items() if name not in MODULES} == {}
    assert sorted(set(MODULES) - set(found)) == [], "a name that nobody shares needs no reason"


def test_no_two_modules_of_tests_share_a_name() -> None:
    """Pytest imports each by its file name alone, and drops the second of two."""
    found = defaultdict(list)
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        if file.stem not in ("__init__", "conftest"):
            found[file.stem].append(str(file.relative_to(Path(__file__).parent)))
    assert "test_names" in found, "modules are found"
    assert shared(found) == {}
