"""A name stands for one idea: which modules and public classes of the package share theirs, and why they may."""

import ast
from collections import defaultdict
from pathlib import Path

import symaware_cli

PACKAGE = Path(symaware_cli.__file__).parent

CLASSES = {
    "Parameters": "what a scenario may write under `with`: a class of each plugin, nested in it",
    "Clock": "the time of a run; the instants of a formula that is evaluated step by step",
    "Constant": "a truth value in the syntax tree, and in the formula that is made of it",
    "Not": "a negation in the syntax tree, and in the formula that is made of it",
}

VERB = "a verb of the terminal, and the module that does it"
BACKEND = "one kind of marks, and how each backend shows it"
WRITTEN = "what a scenario says, what a run makes of it, and how it is recorded"

MODULES = {
    "awareness": "what agents are aware of, and its encoding in the log",
    "bodies": BACKEND,
    "columns": BACKEND,
    "curves": BACKEND,
    "figure": "the geometry of bodies of links and joints; the figure of a plot",
    "figures": BACKEND,
    "motion": "position and velocity, and how a plot shows them",
    "outline": "the outline of a scenario; the outline of a shape",
    "output": "a file that appears whole or not at all, and the output of each backend",
    "plot": VERB,
    "region": "a region of the plane, and what a specification says of it",
    "replay": VERB,
    "request": "a component's request to others; what a plot is asked to show",
    "run": VERB,
    "scenery": "the obstacles of a world, and how they are shown",
    "scope": "what the names of an expression stand for, in conditions and in specifications",
    "sensors": BACKEND,
    "show": VERB,
    "spatial": "a world in space; topologies of positions: both are named by installed entry points",
    "specifications": WRITTEN,
    "time": "simulated time, and panels over it",
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
