"""The package uses the public API only, and is found like any plugin."""

from __future__ import annotations

import ast
import json
from pathlib import Path

from simulating import in_process as command

SOURCES = sorted((Path(__file__).parent.parent / "src").rglob("*.py"))
NAMES = {"drones.barrier", "drones.leaders"}
PUBLIC = {
    "symaware_cli",
    "symaware_cli.formulas",
    "symaware_cli.planning.optimal_control",
    "symaware_cli.planning.optimal_control.qp",
}


def test_only_the_public_api_is_used() -> None:
    assert SOURCES
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            modules = [node.module] if isinstance(node, ast.ImportFrom) else []
            modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            used = {module for module in modules if module and module.partition(".")[0] == "symaware_cli"}
            assert used <= PUBLIC, f"{file.name}: {used}"


def test_the_list_has_the_components() -> None:
    listed = json.loads(command("list", "components", "--json").stdout)
    assert {entry["name"] for entry in listed if entry["package"] == "symaware-drones"} == NAMES
