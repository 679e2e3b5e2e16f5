import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from checkout import CHECKOUT
from games import PlainGame, State, random_game
from rerun_files import saved

from symaware_cli import KnowledgeModel, load, open_log
from symaware_cli.geometry.region import Region
from symaware_cli.knowledge.synthesis.environment_cells import EnvironmentCells
from symaware_cli.knowledge.synthesis.vocabulary import CELL
from symaware_cli.specification.node import Name, walk

SCENARIOS = CHECKOUT / "scenarios"


class Row(KnowledgeModel):
    """Cells in a row, wherever the transitions lead."""

    def prepare(self, regions: Mapping[str, Region]) -> None:
        """Nothing: the test sets the cells."""


def closed_cells(plain: PlainGame, state: State) -> set[int]:
    """The cells into which each move may break a guarantee about the environment."""
    *others, own = plain.variables
    names = {each.name for each in others}
    said = [each for each in plain.guaranteed if names & {one.name for one in walk(each.node) if isinstance(one, Name)}]
    now = dict(zip(plain.names, state[0], strict=True))
    answers = list(itertools.product(*(each.following[now[each.name]] for each in others)))

    def breaks(start: int, end: int) -> bool:
        before = {**now, CELL: start}
        after = [dict(zip(plain.names, (*each, end), strict=True)) for each in answers]
        return any(plain.keeps(plain.assumed, before, e) and not plain.keeps(said, before, e) for e in after)

    found = set()
    for cell in range(own.size):
        moves = [start for start in range(own.size) if start != cell and cell in own.following[start]]
        if moves and all(breaks(start, cell) for start in moves):
            found.add(cell)
    return found


def test_a_cell_is_crossed_exactly_if_each_move_into_it_may_break_what_is_guaranteed_about_the_environment() -> None:
    found = 0
    for seed in range(30):
        game = random_game(np.random.default_rng(seed))
        plain = PlainGame(game)
        model = Row(Row.Parameters())
        model.bounds = np.array([[[k, k + 1.0], [0.0, 1.0]] for k in range(max(each.size for each in plain.variables))])
        cells = EnvironmentCells(game, model)
        agents = sum(each.system is not None for each in game.vocabulary.environment)
        for place, state in enumerate(plain.states):
            table, closed = cells.table(place), closed_cells(plain, state)
            assert {int(each[0]) for each in table if each[4]} == closed
            assert len(table) == len(closed) + agents
            found += bool(closed)
    assert found > 50


def test_a_replay_crosses_out_the_gate_whenever_the_robot_stands_before_it(tmp_path: Path) -> None:
    assert load(SCENARIOS / "gatekeeper.yaml").run(output=tmp_path / "a.mcap").status == "finished"
    log, recording = open_log(tmp_path / "a.mcap"), saved(tmp_path / "a.mcap", tmp_path)
    path = "/awareness/robot/decide.environment/robot"
    strips = recording.values(path, "LineStrips3D:strips")
    times = recording.times(path, "LineStrips3D:strips")
    moved = [(each.time, "open false" in each.text) for each in log.events() if each.name == "environment-moved"]
    assert len(moved) > 20
    for time, is_closed in moved:
        shown = strips[max(place for place, each in enumerate(times) if each <= time)]
        assert len(shown) == (3 if is_closed else 0)  # an outline and two strokes
        if is_closed:
            assert {(round(x), round(y)) for strip in shown for x, y, _ in strip} == {(3, 1), (4, 1), (4, 2), (3, 2)}
    assert any("c2_1" in each.text and "open false" in each.text for each in log.events())
