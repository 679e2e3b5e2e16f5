"""Maps and problems of the benchmarks of Moving AI: `.map` and `.scen` files.

N. R. Sturtevant, Benchmarks for grid-based pathfinding, IEEE Transactions on Computational Intelligence and AI in Games
4 (2012); the format is described at https://movingai.com/benchmarks/formats.html. The first row of a file is the
uppermost row of the map.
"""

from __future__ import annotations

import re
from pathlib import Path as FilePath
from typing import NamedTuple, NoReturn

import numpy as np

from symaware_cli.language import ScenarioError, Source, quoted, read_text
from symaware_cli.maps.picture import MOST_PIXELS
from symaware_cli.maps.raster import FREE, OCCUPIED, Raster

SUFFIXES = (".map",)

#: The cell states of the characters of a map. Swamps are passable; water is, too, but not from the ground, so it is an
#: obstacle.
_CELLS = {".": FREE, "G": FREE, "S": FREE, "@": OCCUPIED, "O": OCCUPIED, "T": OCCUPIED, "W": OCCUPIED}
_SIZE = re.compile(r"(height|width) +(\d{1,7})")
_PROBLEM = 9
_MOST_PROBLEMS = 100_000


class GridProblem(NamedTuple):
    """A problem of a `.scen` file.

    Attributes:
        start: Column and row of the start, from the lower left corner.
        goal: Column and row of the goal.
        length: The length of its best path, in cells.
    """

    start: tuple[int, int]
    goal: tuple[int, int]
    length: float


def read_map(path: FilePath, resolution: float) -> tuple[Raster, bytes]:
    """Read a map whose lower left corner is at the origin.

    Args:
        path: The file.
        resolution: The side of its cells [m].

    Returns:
        The map, and the content of the file.

    Raises:
        ScenarioError: It is wrong; has the first problem at its place in the file.
    """
    source = _read(path, "a map of Moving AI", SUFFIXES)
    lines = source.text.splitlines()
    sizes: dict[str, int] = {}
    for number, name in ((1, "height"), (2, "width")):
        match = _SIZE.fullmatch(lines[number].strip()) if number < len(lines) else None
        if match is None or match[1] != name:
            _refuse(source, f"line {number + 1} of a map says `{name} N`", number)
        sizes[name] = int(match[2])
    height, width = sizes["height"], sizes["width"]
    if not re.fullmatch(r"type +octile", lines[0].strip()):
        _refuse(source, "a map begins with `type octile`", 0)
    if len(lines) < 4 or lines[3].strip() != "map":
        _refuse(source, "line 4 of a map is `map`", 3)
    if not 1 <= height * width <= MOST_PIXELS:
        _refuse(source, f"a map has 1 to {MOST_PIXELS:,} cells, and this one {height} x {width}", 1)
    rows = [line.rstrip("\r") for line in lines[4:]]
    while rows and not rows[-1].strip():
        rows.pop()
    if len(rows) != height:
        _refuse(source, f"there are {len(rows)} rows, and the height is {height}", min(4 + height, len(lines) - 1))
    table = np.full(256, -1, np.int8)
    for character, cell in _CELLS.items():
        table[ord(character)] = cell
    cells = np.empty((height, width), np.int8)
    for number, row in enumerate(rows):
        if len(row) != width:
            _refuse(source, f"the row has {len(row)} cells, and the width is {width}", 4 + number)
        found = table[np.frombuffer(row.encode("latin-1", "replace"), np.uint8)]
        if (found < 0).any():
            column = int(np.argmax(found < 0))
            known = " ".join(_CELLS)
            _refuse(source, f"{quoted(row[column])} is no cell; there are: {known}", 4 + number, column)
        cells[number] = found
    return Raster(np.ascontiguousarray(cells[::-1]), resolution, (0.0, 0.0), 0.0), path.read_bytes()


def read_problems(path: FilePath) -> list[GridProblem]:
    """Read the problems of a `.scen` file.

    Raises:
        ScenarioError: It is wrong; has the first problem at its place in the file.
    """
    source = _read(path, "a file of problems of Moving AI", (".scen",))
    lines = source.text.splitlines()
    if not lines or not re.fullmatch(r"version +1(\.0*)?", lines[0].strip()):
        _refuse(source, "a file of problems begins with `version 1`", 0)
    problems: list[GridProblem] = []
    for number, line in enumerate(lines[1:], 1):
        if not line.strip():
            continue
        words = line.split()
        if len(words) != _PROBLEM:
            _refuse(source, f"a problem has {_PROBLEM} words, not {len(words)}", number)
        if len(problems) >= _MOST_PROBLEMS:
            _refuse(source, f"the file has more than {_MOST_PROBLEMS:,} problems", number)
        try:
            width, height, *ends = (int(word) for word in words[2:8])
            length = float(words[8])
        except ValueError:
            _refuse(source, "sizes and cells are whole numbers, and the length is a number", number)
        columns, rows = (ends[0], ends[2]), (ends[1], ends[3])
        if not (all(0 <= each < width for each in columns) and all(0 <= each < height for each in rows)):
            _refuse(source, f"the start or the goal is not on the map of {width} x {height} cells", number)
        if not 0.0 <= length < np.inf:
            _refuse(source, "the length is not a finite number", number)
        start, goal = ((column, height - 1 - row) for column, row in zip(columns, rows, strict=True))
        problems.append(GridProblem(start, goal, length))
    return problems


def _read(path: FilePath, kind: str, suffixes: tuple[str, ...]) -> Source:
    source = read_text(path, str(path), kind, suffixes)
    if source.problems:
        raise ScenarioError(source.problems)
    return source


def _refuse(source: Source, message: str, line: int, column: int = 0) -> NoReturn:
    """Raise a problem at a line and a column, counted from 0."""
    source.report("unsuitable", message, source.text_span(line + 1, column + 1, line + 1, column + 2))
    raise ScenarioError(source.problems)
