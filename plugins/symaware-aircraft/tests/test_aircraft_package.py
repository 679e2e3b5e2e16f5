"""The package uses the public API only, and is found like any plugin."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simulating import Command


SOURCES = sorted((Path(__file__).parent.parent / "src").rglob("*.py"))
NAMES = {"aircraft.dubins", "aircraft.intent", "aircraft.scenario-tree-mpc", "aircraft.tell-waypoint"}


def test_only_the_public_api_is_used() -> None:
    assert SOURCES
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            modules = [node.module] if isinstance(node, ast.ImportFrom) else []
            modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            used = {module for module in modules if module and module.partition(".")[0] == "symaware_cli"}
            assert used <= {"symaware_cli", "symaware_cli.planning.optimal_control"}, f"{file.name}: {used}"


def test_the_list_and_the_schema_of_editors_have_the_components(command: Command) -> None:
    listed = json.loads(command("list", "components", "--json").stdout)
    assert {entry["name"] for entry in listed if entry["package"] == "symaware-aircraft"} == NAMES
    schema = json.loads(command("schema").stdout)
    assert {f"component:{name}" for name in NAMES} <= schema["$defs"].keys()
    properties = schema["$defs"]["component:aircraft.scenario-tree-mpc"]["properties"]
    assert properties["horizon"]["default"] == 30
