"""What it costs to synthesise a strategy: a robot visits two corners of a floor, and keeps off another that moves.

Run it as ``python benchmarks/synthesis.py [CELLS ...]``; it prints CPU seconds and the memory of the whole process.
"""

from __future__ import annotations

import resource
import sys
import time

from symaware_cli.geometry import Region
from symaware_cli.knowledge.abstraction.grid_cells import GridCells
from symaware_cli.knowledge.synthesis.fragment import clauses
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.strategy import synthesise
from symaware_cli.knowledge.synthesis.vocabulary import Variable, Vocabulary

ASSUMPTIONS = ("always walker.middle", "always eventually not walker.dock")
GUARANTEES = (
    "always (next cell) != walker",
    "always not (walker == (next cell) and cell == (next walker))",
    "always eventually (start and not walker.dock)",
    "always eventually end",
)


def game(count: int) -> Game:
    """Return the game on a floor of count x count cells."""
    half, quarter = count // 2, count // 4
    regions = {
        "floor": Region(box=(0, count, 0, count)),
        "start": Region(box=(0, 1, 0, 1)),
        "end": Region(box=(count - 1, count, count - 1, count)),
        "middle": Region(box=(quarter, count - quarter, quarter, count - quarter)),
        "dock": Region(box=(half - 2, half + 2, half - 2, half + 2)),
    }
    floor = GridCells(GridCells.Parameters(cell=1.0, region="floor"))
    floor.prepare(regions)
    vocabulary = Vocabulary(floor.system, [Variable("walker", floor.system)])
    stated = [[Statement(text, clauses(text, vocabulary)) for text in every] for every in (ASSUMPTIONS, GUARANTEES)]
    return Game(vocabulary, *stated)


def main() -> None:
    for count in [int(each) for each in sys.argv[1:]] or [10, 20]:
        start = time.process_time()
        strategy = synthesise(game(count), [0])
        spent = time.process_time() - start
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        size = strategy.game.size
        print(f"{count} x {count} cells: {size:,} states, {spent:.2f} s, {memory:.0f} MB, {strategy.digest[:12]}")


if __name__ == "__main__":
    main()
