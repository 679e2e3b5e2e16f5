"""The interfaces between the rooms of the package."""

import ast
import importlib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

import symaware_cli

PACKAGE = Path(symaware_cli.__file__).parent
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))

#: How many modules of a room others may reach, the room itself among them.
MOST = 8


def imports() -> Iterator[tuple[str, str, str]]:
    """Each name that a module of one room imports from another: place, module, name."""
    for file in sorted(PACKAGE.rglob("*.py")):
        place = file.relative_to(PACKAGE)
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            found: list[tuple[str, str]] = []
            if isinstance(node, ast.ImportFrom) and node.module:
                found = [(node.module, each.name) for each in node.names]
            elif isinstance(node, ast.Import):
                found = [(each.name, "") for each in node.names]
            for module, name in found:
                room = module.removeprefix("symaware_cli.").partition(".")[0]
                if module.startswith("symaware_cli.") and room in ROOMS and room != place.parts[0]:
                    yield str(place), module, name


def imports_of_plugins() -> Iterator[tuple[str, str]]:
    """Each name that a plugin of this repository imports from a room: module, name."""
    for file in sorted((PACKAGE.parent / "plugins").glob("*/src/**/*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("symaware_cli."):
                yield from ((str(node.module), each.name) for each in node.names)


def is_module(name: str) -> bool:
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.with_suffix(".py").exists() or (path / "__init__.py").exists()


def test_at_most_eight_modules_of_a_room_are_reached_from_others() -> None:
    reached = defaultdict(set)
    for _, module, name in imports():
        room = module.split(".")[1]
        reached[room].add(f"{module}.{name}" if is_module(f"{module}.{name}") else module)
    assert len(reached) > 10, "imports are found"
    assert {room: sorted(found) for room, found in reached.items() if len(found) > MOST} == {}


def test_names_that_others_import_from_a_room_are_in_its_interface() -> None:
    unnamed = [
        f"{place} imports {name} from {module}"
        for place, module, name in imports()
        if module.count(".") == 1 and not is_module(f"{module}.{name}") and module != "symaware_cli.cli"
        if name not in importlib.import_module(module).__all__
    ]
    assert unnamed == []


def test_an_interface_has_only_names_that_are_used() -> None:
    used = {*((module, name) for _, module, name in imports()), *imports_of_plugins()}
    listed = {(f"symaware_cli.{room}", name) for room in with_stub() for name in interface(room).__all__}
    assert sorted(listed - used) == []


@pytest.mark.parametrize("room", ["engine", "language", "log", "studies", "views"])
def test_each_name_of_an_interface_exists(room: str) -> None:
    for name in interface(room).__all__:
        assert getattr(interface(room), name) is not None or name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = interface(room).nothing


def with_stub() -> list[str]:
    return [room for room in ROOMS if (PACKAGE / room / "__init__.pyi").exists()]


def interface(room: str):  # type: ignore[no-untyped-def]
    return importlib.import_module(f"symaware_cli.{room}")
