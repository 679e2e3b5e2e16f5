"""Draws architecture.svg: the rooms of the package, and what each imports beyond what those below it import already.

`python docs/pictures/architecture.py` writes the picture; tests/test_architecture.py checks that it is fresh. The
places of the rooms are given here, the arrows come from the imports.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "symaware_cli"
PICTURE = Path(__file__).with_suffix(".svg")

#: The rooms from top to bottom: name, centre (x, y), and what it is, in lines.
ROOMS = {
    "cli": (360, 60, "verbs: arguments, call, print"),
    "api": (360, 150, "load, run, step, sweep"),
    "testing": (124, 150, "for authors of plugins"),
    "learning": (620, 150, "Gymnasium, PettingZoo"),
    "evidence": (360, 275, "verify, diff, certify, falsify"),
    "studies": (360, 365, "sweeps, tables, statistics"),
    "knowledge": (830, 365, "games and their strategies"),
    "processes": (600, 365, "one run in several processes"),
    "views": (130, 455, "replays, plots, exports"),
    "planning": (878, 455, "optimal control, its risks"),
    "worlds": (1060, 365, "PyBullet, Pymunk"),
    "maps": (378, 455, "floors, paths over them"),
    "promises": (1060, 275, "kept or broken, on beliefs"),
    "bags": (628, 455, "bags of ROS 2"),
    "roads": (1060, 275, "lanes, following, overtaking"),
    "fmi": (628, 275, "FMUs as models"),
    "language": (490, 580, "scenario files"),
    "log": (490, 670, "written, read, repaired"),
    "plugin_files": (760, 580, "code beside a scenario"),
    "engine": (620, 790, "runtime, faults, network, stock components"),
    "assets": (360, 890, "files of robots and meshes"),
    "specification": (880, 890, "formulas and monitors"),
    "core": (230, 990, "agents, components, events"),
    "awareness": (490, 990, "what agents believe"),
    "world": (750, 990, "bodies, chance, time"),
    "geometry": (1010, 990, "shapes and distances"),
}
WIDTH, HEIGHT, HALF, TALL = 1180, 1040, 108, 26

#: Bands behind the rooms: top, bottom, and the words at the left.
BANDS = {
    "entrances": (20, 195, "#eef2f7"),
    "features, which enter by doors": (230, 500, "#e8f3ec"),
    "scenarios and logs": (535, 715, "#fdf3e3"),
    "the engine": (750, 830, "#fbe9e7"),
    "the vocabulary": (850, 1030, "#eef2f7"),
}


def imports() -> Mapping[str, set[str]]:
    """The rooms that the modules of each room import."""
    found: dict[str, set[str]] = {room: set() for room in ROOMS}
    for file in PACKAGE.rglob("*.py"):
        room = file.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if room in ROOMS:
            found[room] |= {each for each in _named(file) if each in ROOMS} - {room}
    return found


def _named(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        modules = []
        if isinstance(node, ast.ImportFrom) and node.module:
            modules = [node.module, *(f"{node.module}.{each.name}" for each in node.names)]
        elif isinstance(node, ast.Import):
            modules = [each.name for each in node.names]
        for module in modules:
            package, _, rest = module.partition(".")
            if package == PACKAGE.name and rest:
                yield rest.partition(".")[0]


def reduced(graph: Mapping[str, set[str]]) -> Iterator[tuple[str, str]]:
    """The imports that do not follow from others."""

    def below(room: str) -> set[str]:
        return graph[room].union(*(below(each) for each in graph[room]))

    for room in graph:
        for other in sorted(graph[room]):
            if not any(other in below(each) for each in graph[room] - {other}):
                yield room, other


def drawn() -> str:
    """The picture as SVG."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif">',
        "<title>The rooms of the package, and what each imports</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">',
        '<path d="M0 0 8 4 0 8z" fill="#555"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
    ]
    for words, (top, bottom, colour) in BANDS.items():
        parts.append(f'<rect x="10" y="{top}" width="{WIDTH - 20}" height="{bottom - top}" rx="8" fill="{colour}"/>')
        parts.append(f'<text x="24" y="{top + 22}" font-size="15" fill="#666">{escape(words)}</text>')
    parts += [_arrow(*edge) for edge in reduced(imports())]
    for room, (x, y, words) in ROOMS.items():
        half = HALF + 50 if room == "engine" else HALF
        box = f'x="{x - half}" y="{y - TALL}" width="{2 * half}" height="{2 * TALL}" rx="6"'
        parts.append(f'<rect {box} fill="white" stroke="#888"/>')
        middle = f'x="{x}" text-anchor="middle"'
        name = room if (PACKAGE / f"{room}.py").exists() else f"{room}/"
        parts.append(f'<text {middle} y="{y - 4}" font-size="17" font-weight="bold">{name}</text>')
        parts.append(f'<text {middle} y="{y + 15}" font-size="13" fill="#444">{escape(words)}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _arrow(start: str, end: str) -> str:
    (x, y), (to_x, to_y) = (map(float, ROOMS[each][:2]) for each in (start, end))
    if y == to_y:
        path = f"M{x + HALF:g} {y:g}H{to_x - HALF - 2:g}"
    else:
        x, to_x = x + (to_x - x) * 0.15, to_x - (to_x - x) * 0.15
        top, bottom = y + TALL, to_y - TALL - 2
        path = f"M{x:g} {top:g}C{x:g} {(top + bottom) / 2:g} {to_x:g} {(top + bottom) / 2:g} {to_x:g} {bottom:g}"
    return f'<path d="{path}" fill="none" stroke="#555" stroke-width="1.5" marker-end="url(#tip)"/>'


if __name__ == "__main__":
    PICTURE.write_text(drawn(), encoding="utf-8")
