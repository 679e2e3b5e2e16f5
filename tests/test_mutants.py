"""Mutants: the mutation tool draws small faults in modules that still compile."""

import ast
import json
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fuzzing.mutants import FOLDERS, PACKAGE, Mutant, drawn, marked, mutants, rounds, verdict


@pytest.fixture(autouse=True)
def checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parent.parent)


def changes(tmp_path: Path, source: str) -> set[str]:
    path = tmp_path / "module.py"
    path.write_text(source)
    return {mutant.applied(source) for mutant in mutants(path)}


def test_a_seed_draws_the_same_mutants_from_each_folder_again() -> None:
    chosen = drawn(10, seed=3)
    assert chosen == drawn(10, seed=3) != drawn(10, seed=4)
    shares = Counter(
        folder for mutant in chosen for folder in FOLDERS if Path(mutant.path).is_relative_to(PACKAGE / folder)
    )
    assert shares == dict(zip(FOLDERS, (2, 2, 2, 2, 1, 1), strict=True))


def test_every_mutant_compiles_and_is_another_module_and_so_does_a_module_with_marks() -> None:
    chosen = drawn(200, seed=5)
    for mutant in chosen:
        source = Path(mutant.path).read_text()
        assert ast.dump(ast.parse(mutant.applied(source))) != ast.dump(ast.parse(source))
    for path in {mutant.path for mutant in chosen}:
        ast.parse(marked(Path(path).read_text(), [each for each in chosen if each.path == path], Path("record")))


def test_operators_conditions_constants_results_and_calls_are_changed(tmp_path: Path) -> None:
    assert changes(tmp_path, "a = b < 1\n") == {"a = (b <= 1)\n", "a = b < (2)\n"}
    assert changes(tmp_path, "a = b and not c\n") == {"a = (b or not c)\n", "a = b and (c)\n"}
    assert changes(tmp_path, "def f():\n    g('ä')\n    return 'ü'\n") == {
        "def f():\n    pass\n    return 'ü'\n",
        "def f():\n    g('ä')\n    return None\n",
    }


def test_annotations_errors_and_imports_for_types_stay(tmp_path: Path) -> None:
    assert not changes(
        tmp_path, "if TYPE_CHECKING:\n    a = 1\n\nx: Literal[1]\n\n\ndef f(y: Literal[2]): raise E(3)\n"
    )


def test_a_module_with_marks_does_the_same_on_the_same_lines_and_records_who_reaches_them(tmp_path: Path) -> None:
    source = "def f(x):\n    g.append(-1 + x < 2 and (\n        x > 3))\n    return x + 4\n\n\ng = [5]\n"
    (tmp_path / "module.py").write_text(source)
    chosen = mutants(tmp_path / "module.py")
    record = tmp_path / "record"
    marks = marked(source, chosen, record)
    assert marks.count("\n") == source.count("\n")
    names: dict[str, Any] = {}
    exec(marks, names)
    assert (names["f"](1), names["f"](7), names["g"]) == (5, 11, [5, False, False])
    found = [json.loads(line) for line in record.read_text().splitlines()]
    assert {name for name, _ in found} == {mutant.name for mutant in chosen if mutant.line < 5}  # 7 is of the module
    assert {test.partition(" ")[0] for _, test in found} == {os.environ["PYTEST_CURRENT_TEST"].partition(" ")[0]}
    assert len(found) == len(chosen) - 1


def test_tests_of_the_folder_come_first_and_what_prepares_one_stands_for_all_of_its_file() -> None:
    def rounds_of(*reached: str) -> list[list[str]]:
        return rounds(Mutant("symaware_cli/engine/network/outbox.py", 1, 0, 0, "", ""), reached)

    folder = "tests/engine/network"
    assert rounds_of(
        "",
        "tests/api/test_run.py::test_a (call)",
        f"{folder}/test_channel.py::test_b (setup)",
        f"{folder}/test_channel.py::test_c (call)",
        f"{folder}/test_outbox.py::test_d[1 2] (call)",
    ) == [
        [f"{folder}/test_outbox.py::test_d[1 2]", f"{folder}/test_channel.py"],
        ["tests/api/test_run.py::test_a"],
    ]
    assert rounds_of("") == [[folder], []]


@pytest.fixture
def checked(tmp_path: Path) -> Callable[[str], dict[str, object]]:
    """A checkout with one module, and the verdict on a mutant of it after some tests."""
    (tmp_path / "doubling.py").write_text("def double(x):\n    return x * 2\n")
    (tmp_path / "pytest.ini").write_text("[pytest]\n")

    def verdict_of(tests: str) -> dict[str, object]:
        (tmp_path / "test_doubling.py").write_text(f"from doubling import double\n\n\n{tests}")
        (mutant,) = (each for each in mutants(tmp_path / "doubling.py") if each.after == "(x + 2)")
        found = verdict(replace(mutant, path="doubling.py"), ["test_doubling.py"], tmp_path)
        assert (tmp_path / "doubling.py").read_text() == "def double(x):\n    return x * 2\n"
        return found

    return verdict_of


def test_a_mutant_is_killed_by_a_test_that_fails_with_it_alone(checked: Callable[[str], dict[str, object]]) -> None:
    assert checked("def test_it():\n    assert double(3) == 6\n") == {
        "killed": True,
        "by": "test_doubling.py::test_it",
    }


def test_a_test_that_fails_in_any_case_kills_no_mutant(checked: Callable[[str], dict[str, object]]) -> None:
    assert not checked("def test_it():\n    assert double(2) == 5\n")["killed"]


def test_a_test_that_fails_now_and_then_kills_no_mutant(checked: Callable[[str], dict[str, object]]) -> None:
    assert not checked(
        "def test_it():\n"
        "    from pathlib import Path\n\n"
        "    before = Path('failed').exists()\n"
        "    Path('failed').touch()\n"
        "    assert before\n"
    )["killed"]
