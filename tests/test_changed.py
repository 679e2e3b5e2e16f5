"""`pytest --changed` runs every test that concerns a change, as far as imports and names show."""

import pytest
from changed import TESTS, concerned, located

#: One process reads the imports, which are the same for all of these tests.
pytestmark = pytest.mark.xdist_group("changed")


def found(module: str) -> set[str]:
    file = located(module)
    assert file is not None
    return {path.stem for path in TESTS.rglob("test_*.py") if concerned(path, frozenset([file]))}


@pytest.mark.parametrize(
    ("module", "tests"),
    [
        ("symaware_cli.planning.control.mpc", {"test_mpc", "test_feedback_policy"}),
        ("symaware_cli.cli.merge", {"test_cli_merge"}),
        ("symaware_cli.log.digest", {"test_scenario", "test_cli_run"}),
        ("sweeping", {"test_sweep_paths"}),
        ("test_changed", {"test_changed"}),
    ],
)
def test_tests_that_import_or_name_what_changed_are_found(module: str, tests: set[str]) -> None:
    assert tests <= found(module)


def test_a_change_of_a_verb_concerns_few_tests() -> None:
    assert len(found("symaware_cli.cli.merge")) < 10
