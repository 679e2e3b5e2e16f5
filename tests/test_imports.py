"""The imports of modules, including those for types alone or within a function."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import symaware_cli

PACKAGE = Path(symaware_cli.__file__).parent


def modules() -> dict[str, Path]:
    named = {".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts): file for file in PACKAGE.rglob("*.py")}
    return {name.removesuffix(".__init__"): file for name, file in named.items()}


def imported(file: Path, known: set[str]) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names & known or {node.module}
    return found & known


def test_no_module_imports_one_that_imports_it() -> None:
    files = modules()
    graph = {name: imported(file, set(files)) - {name} for name, file in files.items()}
    assert len(graph["symaware_cli.core.component"]) > 5, "imports are found"
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(" <- ".join(error.args[1])) from None
