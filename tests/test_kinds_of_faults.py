"""A kind of fault is one module and one entry point: no other module of the package names the kinds."""

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

import symaware_cli

PACKAGE = Path(symaware_cli.__file__).parent
KINDS = PACKAGE / "engine" / "faults"
POINTS = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())["project"]["entry-points"]["symaware.faults"]

#: The modules of kinds: most are in that folder, and those about a feature are in its room.
HOMES = {PACKAGE.parent / (target.partition(":")[0].replace(".", "/") + ".py") for target in POINTS.values()}

#: Modules of the folder that are no kinds.
BASES = {"component_fault": "of components", "message_fault": "of messages and links"}

#: Words in modules that deal with faults, which are keys of kinds as well.
OTHERWISE = {
    "evidence/branch_changes.py": "writes changes of a run as faults of the branch's scenario, in its notation",
    "evidence/causes/candidate.py": "writes the belief that a branch makes true as a fault, in its notation",
    "engine/runtime/timing.py": "`stop` and `restart`: values of `on_failure`",
    "language/document.py": "`stop` and `restart`: values of `on_failure`",
    "testing/repeatability.py": "`replace`: how undecodable bytes are treated",
}


def trees() -> Iterator[tuple[str, ast.AST]]:
    """Yield each module that is no kind and outside of the folder of kinds, with its syntax tree."""
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.parent != KINDS and path not in HOMES:
            yield path.relative_to(PACKAGE).as_posix(), ast.parse(path.read_text(encoding="utf-8"))


def words(tree: ast.AST) -> set[str]:
    """The texts, names and attributes in a module, without its docstrings and comments."""
    found = set()
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) | ast.Name(id=text) | ast.Attribute(attr=text) | ast.alias(name=text):
                found.add(text)
            case ast.keyword(arg=str(text)) | ast.arg(arg=text):
                found.add(text)
    return found


def texts(tree: ast.AST) -> set[str]:
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def deals_with_faults(tree: ast.AST) -> bool:
    return any(
        word.lower().rpartition(".")[2].strip("_") in ("fault", "faults", "fault_section") for word in words(tree)
    )


def test_each_module_of_the_folder_is_registered_by_one_line_for_each_kind() -> None:
    registered = {target.partition(":")[0] for target in POINTS.values()}
    modules = {f"symaware_cli.engine.faults.{path.stem}" for path in KINDS.glob("*.py")}
    assert modules - registered == {f"symaware_cli.engine.faults.{name}" for name in (*BASES, "__init__")}
    assert all(path.is_file() for path in HOMES)


def test_no_other_module_names_the_class_or_the_module_of_a_kind() -> None:
    classes = {target.partition(":")[2] for target in POINTS.values()}
    named = {place: found for place, tree in trees() if (found := classes & words(tree))}
    assert named == {}
    imported = {
        place for place, tree in trees() if any(word.startswith("symaware_cli.engine.faults") for word in words(tree))
    }
    assert imported == set()


def test_no_other_module_that_deals_with_faults_knows_the_key_of_a_kind() -> None:
    dealing = {place: tree for place, tree in trees() if deals_with_faults(tree)}
    assert {
        "language/fault_builder.py",
        "engine/runtime/fault_scheduler.py",
        "language/json_schema.py",
    } <= dealing.keys()
    named = {place: found for place, tree in dealing.items() if (found := POINTS.keys() & texts(tree))}
    assert {place: found for place, found in named.items() if place not in OTHERWISE} == {}
    assert sorted(OTHERWISE.keys() - named.keys()) == [], "an exception that is none any more"
