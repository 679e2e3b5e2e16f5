"""Specifications are a table in a replay: state, robustness and what components record of them, as numbers and bars."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views.detail import detail_of
from symaware_cli.views.scene.marks import Documents
from symaware_cli.views.scene.scene import Scene
from symaware_cli.views.scene.specification_marks import SpecificationTable
from symaware_cli.views.views import run_view_of

SCENARIO = CHECKOUT / "scenarios" / "shortcut.yaml"


def rows_at(path: Path, second: float, size: int = 1 << 22) -> dict[str, Sequence[str]]:
    log = open_log(path)
    run_view = run_view_of(log)
    scene = Scene(run_view, detail_of(run_view), [SpecificationTable])
    texts: dict[int, str] = {}
    for chunk in scene.chunk_reader().chunks(log.messages(), size):
        for mark in scene.marks(chunk):
            assert isinstance(mark, Documents)
            assert not texts.keys() & {*mark.times.tolist()}
            texts |= dict(zip(mark.times.tolist(), mark.texts, strict=True))
    lines = texts[round(second * 1e9)].splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in (lines[0], *lines[2:])]
    return {row[0]: row[1:] for row in cells}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("log") / "shortcut.mcap"
    execute(build(SCENARIO, ["run.duration=6", "specifications.apart.from=2"]), found)
    return found


def test_a_row_has_the_state_the_robustness_and_its_bar(path: Path) -> None:
    before, after = rows_at(path, 1.0), rows_at(path, 6.0)
    assert before["apart"] == ["", "", "", ""]
    assert (after["apart"][0], before["safe"][0]) == ("**violated**", "active")
    assert float(after["apart"][2]) < 0.0
    assert after["apart"][3] == ""
    bars = {name: len(row[3]) for name, row in before.items() if row[3]}
    assert max(bars.values()) == 18


def test_chunks_do_not_matter(path: Path) -> None:
    assert rows_at(path, 4.0, 5_000) == rows_at(path, 4.0)


def test_a_column_names_the_holder_of_each_offer(tmp_path: Path) -> None:
    path = tmp_path / "errands.mcap"
    execute(build(SCENARIO.parent / "errands.yaml"), path)
    events = [event for event in open_log(path).events() if event.name in ("accepted", "released", "rejected")]
    told = [(event.time // 100_000_000, event.name, event.data["specification"]) for event in events]
    assert (61, "released", "flowers") in told
    assert ("rejected", "piano") in [each[1:] for each in told]
    first, again = (event.data["agent"] for event in events if told[events.index(event)][1:] == ("accepted", "flowers"))
    shown = {second: rows_at(path, second) for second in (0.5, 4.2, 5.0, 6.1, 7.0, 24.0)}
    assert shown[0.5]["specification"][0] != "held by"
    assert {rows["specification"][0] for second, rows in shown.items() if second > 1} == {"held by"}
    assert [shown[second]["flowers"][0] for second in (4.2, 5.0, 6.1, 7.0)] == ["(open)", first, "(open)", again]
    assert shown[24.0]["piano"][0] == "(rejected)"
    # The other couriers have not accepted it, so that their verdicts do not count.
    assert [shown[24.0][name][1] for name in ("painting", "flowers", "piano")] == ["satisfied", "satisfied", ""]
    # Of a window of 20 s, from when it was first offered at 4 s on.
    assert [shown[second]["flowers"][2] for second in (0.5, 4.2, 7.0)] == ["", "24", "24"]


def test_a_column_has_the_end_of_each_window(tmp_path: Path) -> None:
    path = tmp_path / "shortcut.mcap"
    changes = ["run.duration=6", "specifications.apart.from=2", "specifications.apart.to=3"]
    execute(build(SCENARIO, [*changes, "specifications.safe.formula=always[0, 1.5] speed < 9"]), path)
    before, after = rows_at(path, 1.0), rows_at(path, 2.5)
    assert before["specification"][1] == "until [s]"
    assert [before[name][1] for name in ("safe", "apart")] == ["1.5", ""]
    assert after["apart"][1] == "3"
    whole = {row[1] for name, row in after.items() if name not in ("specification", "safe", "apart")}
    assert whole <= {"6"}
