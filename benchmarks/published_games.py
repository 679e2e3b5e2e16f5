"""What it costs to solve two families of games that papers on GR(1) report: arbiters and lift controllers.

After Bloem, Jobstmann, Piterman, Pnueli and Sa'ar, Synthesis of Reactive(1) designs, Journal of Computer and System
Sciences 78(3), 2012. Here the agent moves first, and what it chooses is one of finitely many cells: whom an arbiter
grants, or the floor of a lift. ``python benchmarks/published_games.py`` prints CPU seconds. With ``--slugs PATH`` it
also runs slugs (Ehlers and Raman, CAV 2016, https://github.com/VerifiableRobotics/slugs), built from source, on the
same formulas. Slugs uses decision diagrams, and its environment moves first. Its explicit strategy is comparable with
ours, which is a table; deciding realizability alone takes it less.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from symaware_cli.knowledge import TransitionSystem
from symaware_cli.knowledge.synthesis.fragment import clauses
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.strategy import synthesise
from symaware_cli.knowledge.synthesis.vocabulary import Variable, Vocabulary


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


def slugs_arbiter(lines: int) -> str:
    """Return the game of an arbiter in the language of slugs."""
    every = range(lines)
    return _slugs(
        inputs=[f"r{each}" for each in every],
        outputs=[f"g{each}" for each in every],
        assumed=[f"| | ! r{each} g{each} r{each}'" for each in every],
        guaranteed=[f"! & g{each}' g{other}'" for each in every for other in range(each)],
        initial=[f"! g{each}" for each in every],
        goals=[f"| ! r{each} g{each}" for each in every],
    )


def slugs_lift(floors: int) -> str:
    """Return the game of a lift in the language of slugs."""
    every = range(floors)
    near = {each: [f"f{other}'" for other in every if abs(each - other) <= 1] for each in every}
    return _slugs(
        inputs=[f"b{each}" for each in every],
        outputs=[f"f{each}" for each in every],
        assumed=[f"| ! & b{each} f{each} ! b{each}'" for each in every]
        + [f"| | ! b{each} f{each} b{each}'" for each in every],
        guaranteed=[f"! & f{each}' f{other}'" for each in every for other in range(each)]
        + [f"| ! f{each} {'| ' * (len(near[each]) - 1)}{' '.join(near[each])}" for each in every],
        initial=["f0", *(f"! f{each}" for each in every[1:])],
        goals=[f"| f{each} ! b{each}" for each in every],
    )


def _slugs(
    inputs: Sequence[str],
    outputs: Sequence[str],
    assumed: Sequence[str],
    guaranteed: Sequence[str],
    initial: Sequence[str],
    goals: Sequence[str],
) -> str:
    sections = {
        "INPUT": inputs,
        "OUTPUT": outputs,
        "ENV_TRANS": assumed,
        "SYS_TRANS": guaranteed,
        "SYS_INIT": initial,
        "SYS_LIVENESS": goals,
    }
    return "\n".join("\n".join([f"[{name}]", *lines, ""]) for name, lines in sections.items())


def _spent_by_slugs(program: str, game: str, *options: str) -> float:
    """Run slugs on a game, and return its CPU time [s]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "game.slugsin"
        path.write_text(game)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [program, *options, str(path), *([str(Path(folder) / "strategy")] if options else [])]
        said = subprocess.run(command, capture_output=True, text=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if "is realizable" not in said.stdout + said.stderr:
        raise SystemExit(f"slugs does not find the game realizable: {said.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the CPU time of each game."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--slugs", metavar="PATH", help="the program to compare with")
    slugs = parser.parse_args().slugs
    families = (arbiter, slugs_arbiter, (2, 3, 4, 5, 6)), (lift, slugs_lift, (2, 4, 6, 8, 10))
    for make, make_for_slugs, sizes in families:
        for size in sizes:
            start = time.process_time()
            strategy = synthesise(make(size), [0])
            spent = time.process_time() - start
            line = f"{make.__name__} {size}: {strategy.game.size:,} states, {spent:.2f} s, {strategy.digest[:12]}"
            if slugs:
                game = make_for_slugs(size)
                line += f"; slugs {_spent_by_slugs(slugs, game):.2f} s to decide"
                if (make, size) != (lift, 10):  # more than 10 minutes
                    line += f", {_spent_by_slugs(slugs, game, '--explicitStrategy'):.2f} s with the strategy"
            print(line, flush=True)


if __name__ == "__main__":
    main()
