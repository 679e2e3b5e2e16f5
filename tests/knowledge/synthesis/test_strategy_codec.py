from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT
from games import game

from symaware_cli import TransitionSystem, load, open_log
from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.strategy import synthesise
from symaware_cli.knowledge.synthesis.strategy_codec import decoded, encoded
from symaware_cli.knowledge.synthesis.vocabulary import Variable
from symaware_cli.log.digest import digest

SCENARIOS = CHECKOUT / "scenarios"
HALL = TransitionSystem.of({"a": ["a", "b"], "b": ["b", "a"]}, labels={"left": ["a"], "right": ["b"]})


def hall() -> Game:
    guarantees = ["always eventually right", "always eventually left"]
    return game(HALL, [Variable("open")], ["always eventually open"], guarantees)


def test_a_strategy_in_bytes_has_the_documented_size() -> None:
    made = synthesise(hall(), [0])
    assert len(encoded(made)) == 4 * made.choices.size + -(-made.choices.size // 8)


def test_a_strategy_comes_back_from_its_bytes() -> None:
    made = synthesise(hall(), [0])
    assert decoded(encoded(made), hall()).digest == made.digest


def test_bytes_of_no_strategy_for_the_game_are_refused() -> None:
    content = encoded(synthesise(hall(), [0]))
    beyond = np.full(len(content) // 4, 99, "<i4").tobytes()
    for wrong in (content[:-1], b"", content + b"0", beyond[: len(content)].ljust(len(content), b"\0")):
        with pytest.raises(ValueError, match=r"(of|for) this game"):
            decoded(wrong, hall())


@pytest.mark.parametrize("name", ["rooms.yaml", "door.yaml"])
def test_nothing_outside_of_the_scenario_decides_which_strategy_a_run_follows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No run leaves anything behind that could change the next one, wherever the user's folders are."""
    found = []
    for number in range(2):
        home = tmp_path / "home"
        home.mkdir(exist_ok=True)
        monkeypatch.setenv("HOME", str(home))
        monkeypatch.setenv("XDG_CACHE_HOME", str(home / "cache"))
        log = tmp_path / f"{number}.mcap"
        assert load(SCENARIOS / name, {"run.duration": 3.0}).run(output=log).status == "finished"
        found.append(digest(open_log(log)).combined)
        assert list(home.rglob("*.strategy")) == []
        assert not (home / "cache" / "symaware").exists()
    assert len(set(found)) == 1
