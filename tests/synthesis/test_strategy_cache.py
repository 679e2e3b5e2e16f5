import hashlib
from pathlib import Path

import numpy as np
import pytest
from games import game

from symaware_cli import TransitionSystem, load, open_log
from symaware_cli.recording.digest import digest
from symaware_cli.synthesis import strategy as module
from symaware_cli.synthesis.game import Game
from symaware_cli.synthesis.strategy import synthesise
from symaware_cli.synthesis.strategy_cache import VARIABLE, StrategyCache, encoded, game_digest
from symaware_cli.synthesis.vocabulary import Variable

SCENARIOS = Path(__file__).parents[2] / "scenarios"
HALL = TransitionSystem.of({"a": ["a", "b"], "b": ["b", "a"]}, labels={"left": ["a"], "right": ["b"]})


def hall(guarantee: str = "always eventually right") -> Game:
    return game(HALL, [Variable("open")], ["always eventually open"], [guarantee, "always eventually left"])


def unsolvable(game: Game) -> None:
    raise AssertionError("the game was solved again")


def test_a_strategy_that_was_kept_is_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = StrategyCache(tmp_path)
    made = synthesise(hall(), [0], cache)
    monkeypatch.setattr(module, "solve", unsolvable)
    assert synthesise(hall(), [0], cache).digest == made.digest
    with pytest.raises(AssertionError, match="solved again"):
        synthesise(hall("always eventually (right and open)"), [0], cache)


def test_what_is_wrong_or_damaged_in_the_cache_is_made_again(tmp_path: Path) -> None:
    cache = StrategyCache(tmp_path)
    made = synthesise(hall(), [0], cache)
    (path,) = tmp_path.iterdir()
    content = path.read_bytes()
    staying = np.zeros(made.choices.size, "<i4").tobytes()  # never goes to the right
    wrong = staying + content[len(staying) : -32]
    sealed = wrong + hashlib.sha256(wrong).digest()
    for damaged in (content[:-1], b"", wrong + content[-32:], sealed, b"\xff" * len(content)):
        path.write_bytes(damaged)
        assert synthesise(hall(), [0], cache).digest == made.digest
        assert path.read_bytes() == content


def test_a_cache_that_cannot_be_written_is_none(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    synthesise(hall(), [0], StrategyCache(tmp_path / "file"))


def test_games_that_differ_have_other_digests() -> None:
    others = [hall(), hall("always eventually open"), game(HALL, [], [], ["always eventually right"])]
    assert len({game_digest(each) for each in others}) == 3
    assert game_digest(hall()) == game_digest(hall())


def test_cached_and_fresh_strategies_give_equal_logs_that_contain_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, folder = [], tmp_path / "cache"
    for number, cache in enumerate(("", str(folder), str(folder))):
        monkeypatch.setenv(VARIABLE, cache)
        log = tmp_path / f"{number}.mcap"
        scenario = load(SCENARIOS / "door.yaml", {"run.duration": 5.0})
        assert scenario.run(output=log).status == "finished"
        found.append(digest(open_log(log)).combined)
        (kept,) = [each.read_bytes() for each in folder.iterdir()] if cache else [None]
        attached = open_log(log).attachments["agents.robot.decide/strategy"]
        assert kept is None or kept.startswith(attached)
    assert len(set(found)) == 1


def test_a_strategy_in_bytes_has_the_documented_size() -> None:
    made = synthesise(hall(), [0])
    assert len(encoded(made)) == 4 * made.choices.size + -(-made.choices.size // 8)
