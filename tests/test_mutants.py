"""Mutants: what the mutation tool draws are small faults in modules that still compile."""

import ast
from collections import Counter
from pathlib import Path

import pytest

from fuzzing.mutants import FOLDERS, Mutant, candidates, drawn, mutants


@pytest.fixture(autouse=True)
def checkout(monkeypatch):
    monkeypatch.chdir(Path(__file__).parent.parent)


def changes(tmp_path, source):
    path = tmp_path / "module.py"
    path.write_text(source)
    return {mutant.applied(source) for mutant in mutants(path)}


def test_a_seed_draws_the_same_mutants_from_each_folder_again():
    chosen = drawn(10, seed=3)
    assert chosen == drawn(10, seed=3) != drawn(10, seed=4)
    assert Counter(Path(mutant.path).parts[1] for mutant in chosen) == dict(zip(FOLDERS, (3, 3, 2, 2), strict=True))


def test_every_mutant_compiles_and_is_another_module():
    for mutant in drawn(200, seed=5):
        source = Path(mutant.path).read_text()
        assert ast.dump(ast.parse(mutant.applied(source))) != ast.dump(ast.parse(source))


def test_operators_conditions_constants_results_and_calls_are_changed(tmp_path):
    assert changes(tmp_path, "a = b < 1\n") == {"a = (b <= 1)\n", "a = b < (2)\n"}
    assert changes(tmp_path, "a = b and not c\n") == {"a = (b or not c)\n", "a = b and (c)\n"}
    assert changes(tmp_path, "def f():\n    g('ä')\n    return 'ü'\n") == {
        "def f():\n    pass\n    return 'ü'\n",
        "def f():\n    g('ä')\n    return None\n",
    }


def test_annotations_errors_and_imports_for_types_stay(tmp_path):
    assert not changes(
        tmp_path, "if TYPE_CHECKING:\n    a = 1\n\nx: Literal[1]\n\n\ndef f(y: Literal[2]): raise E(3)\n"
    )


def test_tests_named_like_the_module_come_before_those_of_its_folder():
    mutant = Mutant("symaware_cli/network/outbox.py", 1, 0, 0, "", "")
    named, folder, wider = candidates(mutant)
    assert named == ["tests/network/test_outbox.py"]
    assert folder == ["tests/network"]
    assert all(Path(each).exists() for each in wider)
