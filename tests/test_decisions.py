"""The decisions: all are in their index, and modules point to the ones that bind them."""

import re
from pathlib import Path

TOP = Path(__file__).parents[1]
DECISIONS = TOP / "docs" / "decisions"
#: Decisions that bind no module of the package, with what they bind.
ELSEWHERE = {
    2: "dependencies in pyproject.toml",
    6: "constraints.txt",
    26: "the order of packages, which import-linter checks",
    39: "a plugin",
    43: "a plugin",
    52: "a program in benchmarks",
    105: "docs/website",
}


def pages() -> dict[int, Path]:
    return {int(path.name[:4]): path for path in sorted(DECISIONS.glob("[0-9]*.md"))}


def test_the_index_has_every_decision_with_its_title_date_and_status() -> None:
    rows = re.findall(
        r"^\| \[(\d+)\]\((\S+)\) \| (.+) \| \d{4}-\d\d-\d\d \| \S.* \|$", (DECISIONS / "README.md").read_text(), re.M
    )
    expected = [
        (str(number), path.name, path.read_text().partition("\n")[0].removeprefix(f"# {number}. "))
        for number, path in pages().items()
    ]
    assert rows == expected


def test_modules_point_to_decisions_that_exist_and_each_decision_is_pointed_to() -> None:
    named: set[int] = set()
    for folder in ("symaware_cli", "plugins", "benchmarks", "fuzzing", "tests"):
        for path in (TOP / folder).rglob("*.py"):
            for number, name in re.findall(r"docs/decisions/((\d{4})[\w.-]*)", path.read_text()):
                assert int(name) in pages(), f"{path.name} names {number}"
                named.add(int(name))
    assert set(pages()) - named - set(ELSEWHERE) == set()
