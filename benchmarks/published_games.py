"""What it costs to solve two families of games that papers on GR(1) report: arbiters and lift controllers.

After Bloem, Jobstmann, Piterman, Pnueli and Sa'ar, Synthesis of Reactive(1) designs, Journal of Computer and System
Sciences 78(3), 2012. Here the agent moves first, and what it chooses is one of finitely many cells: whom an arbiter
grants, or the floor of a lift. Run it as ``python benchmarks/published_games.py``; it prints CPU seconds.
"""

from __future__ import annotations

import time

from symaware_cli.abstraction.transition_system import TransitionSystem
from symaware_cli.synthesis.fragment import clauses
from symaware_cli.synthesis.game import Game, Statement
from symaware_cli.synthesis.strategy import synthesise
from symaware_cli.synthesis.vocabulary import Variable, Vocabulary


def arbiter(lines: int) -> Game:
    """Return the game of an arbiter that answers each of some request lines, and grants one at a time."""
    names = ["none", *(f"g{each}" for each in range(lines))]
    system = TransitionSystem.of(dict.fromkeys(names, names), ["none"], {name: [name] for name in names})
    # A request stays until it is granted.
    assumed = [f"always (r{each} and not g{each} implies next r{each})" for each in range(lines)]
    return _game(system, "r", lines, assumed, [f"always (r{each} implies eventually g{each})" for each in range(lines)])


def lift(floors: int) -> Game:
    """Return the game of a lift that goes from floor to floor and answers each call."""
    names = [f"f{each}" for each in range(floors)]
    moves = {name: names[max(place - 1, 0) : place + 2] for place, name in enumerate(names)}
    system = TransitionSystem.of(moves, ["f0"], {name: [name] for name in names})
    assumed = []
    for each in range(floors):
        assumed += [f"always (b{each} and f{each} implies not next b{each})"]  # a call is over when the lift is there
        assumed += [f"always (b{each} and not f{each} implies next b{each})"]  # and not before
    return _game(
        system, "b", floors, assumed, [f"always eventually (f{each} or not b{each})" for each in range(floors)]
    )


def _game(system: TransitionSystem, letter: str, count: int, assumed: list[str], guaranteed: list[str]) -> Game:
    vocabulary = Vocabulary(system, [Variable(f"{letter}{each}") for each in range(count)])
    stated = [[Statement(text, clauses(text, vocabulary)) for text in every] for every in (assumed, guaranteed)]
    return Game(vocabulary, *stated)


def main() -> None:
    for name, make, sizes in (("arbiter", arbiter, (2, 3, 4, 5, 6)), ("lift", lift, (2, 4, 6, 8, 10))):
        for size in sizes:
            start = time.process_time()
            strategy = synthesise(make(size), [0])
            spent = time.process_time() - start
            print(f"{name} {size}: {strategy.game.size:,} states, {spent:.2f} s, {strategy.digest[:12]}", flush=True)


if __name__ == "__main__":
    main()
