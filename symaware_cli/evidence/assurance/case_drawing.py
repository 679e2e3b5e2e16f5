"""Pictures of assurance cases, in the symbols of the Goal Structuring Notation, version 3.

Goals are rectangles, strategies parallelograms, solutions circles, context is rounded, assumptions and justifications
are ellipses marked with A and J. Filled arrowheads point to the support of an element, hollow ones to its context.

Source: The Assurance Case Working Group, "Goal Structuring Notation Community Standard, Version 3", SCSC-141C, 2021.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape

from symaware_cli.evidence.assurance.case_document import CaseDocument

#: Sizes in pixels: of characters, lines, the boxes of all elements, and the space between them.
_CHARACTER, _LINE, _WIDTH, _ACROSS, _DOWN = 6.6, 16, 190, 26, 56
_PADDING = 12
#: Characters per line in a box; circles and slanted boxes have room for fewer.
_WRAP = {"solution": 17, "strategy": 24, "assumption": 20, "justification": 20}
_COLOURS = {"holds": ("#e8f5e9", "#2e7d32"), "fails": ("#fdecea", "#c62828"), "open": ("#fffbe6", "#8d6e00")}
_PLAIN = ("#f5f7fa", "#546e7a")


@dataclass
class _Box:
    """An element as it is drawn.

    Attributes:
        kind: The kind of the element, which determines the symbol.
        lines: The lines of the text; the first is the identifier.
        height: The height [px].
        x: The horizontal position of the centre [px].
        y: The vertical position of the top [px].
        colours: The colours of the area and of the outline.
    """

    kind: str
    lines: list[str]
    height: float
    colours: tuple[str, str]
    x: float = 0.0
    y: float = 0.0


def drawing(document: CaseDocument, statuses: Mapping[str, str]) -> str:
    """Return the picture as SVG.

    Args:
        document: The case.
        statuses: ``holds``, ``fails`` or ``open`` for each goal, strategy and solution.
    """
    return _Drawing(document, statuses).text()


class _Drawing:
    def __init__(self, document: CaseDocument, statuses: Mapping[str, str]) -> None:
        self._document = document
        self._boxes: dict[str, _Box] = {}
        self._levels: dict[str, int] = {}
        self._statuses = statuses
        self._place()

    def _place(self) -> None:
        """Place elements in rows by their distance from the top goal, each above its support."""
        document = self._document
        self._level(document.top, 0)
        order = sorted(self._levels, key=self._levels.__getitem__)
        for name in order:
            self._boxes[name] = self._box(name)
        tops, y = {}, 24.0
        for level in range(max(self._levels.values()) + 1):
            tops[level] = y
            row = [name for name in order if self._levels[name] == level]
            sides = [self._side(name) for name in row]
            y += max([self._boxes[name].height for name in row] + [self._stack(side) for side in sides]) + _DOWN
        self._height = y - _DOWN + 40
        self._across = 24.0
        placed: set[str] = set()
        self._spread(document.top, placed)
        # Elements of a row keep their order, and never overlap with the context of their neighbours.
        for name in order:
            self._boxes[name].y = tops[self._levels[name]]
            left = self._boxes[name].x + _WIDTH / 2 + _ACROSS
            below = self._boxes[name].y
            for each in self._side(name):
                if each not in self._boxes:
                    box = self._boxes[each] = self._box(each)
                    box.x, box.y = left + _WIDTH / 2, below
                    below += box.height + 10
        self._width = max(box.x for box in self._boxes.values()) + _WIDTH / 2 + 24

    def _level(self, name: str, level: int) -> None:
        if level <= self._levels.get(name, -1):
            return
        self._levels[name] = level
        for each in self._below(name):
            self._level(each, level + 1)

    def _below(self, name: str) -> list[str]:
        argument = self._document.arguments.get(name)
        return [] if argument is None else argument.by

    def _side(self, name: str) -> list[str]:
        """Return the context that is drawn beside an element: the context to which no other element refers earlier."""
        seen: set[str] = set()
        for each in sorted(self._levels, key=self._levels.__getitem__):
            argument = self._document.arguments.get(each)
            fresh = [] if argument is None else [one for one in argument.context if one not in seen]
            if each == name:
                return fresh
            seen.update(fresh)
        return []

    def _stack(self, names: list[str]) -> float:
        return sum(self._box(each).height + 10 for each in names)

    def _spread(self, name: str, placed: set[str]) -> float:
        """Place an element above its support, to the right of all placed elements; return its horizontal centre."""
        placed.add(name)
        below = [self._spread(each, placed) for each in self._below(name) if each not in placed]
        width = _WIDTH + (_WIDTH + _ACROSS if self._side(name) else 0)
        if below:
            self._boxes[name].x = (below[0] + below[-1]) / 2
            self._across = max(self._across, self._boxes[name].x - _WIDTH / 2 + width + _ACROSS)
        else:
            self._boxes[name].x = self._across + _WIDTH / 2
            self._across += width + _ACROSS
        return self._boxes[name].x

    def _box(self, name: str) -> _Box:
        document = self._document
        sections = {
            "goal": {key: each.text for key, each in document.goals.items()},
            "strategy": {key: each.text for key, each in document.strategies.items()},
            "solution": {key: each.shown for key, each in document.solutions.items()},
            "context": document.context,
            "assumption": document.assumptions,
            "justification": document.justifications,
        }
        kind = next(key for key, entries in sections.items() if name in entries)
        lines = [name, *textwrap.wrap(sections[kind][name], _WRAP.get(kind, 27))]
        height: float = len(lines) * _LINE + 2 * _PADDING
        if kind == "solution":
            height = max(_WIDTH * 0.72, height * 1.25)
        elif kind in ("assumption", "justification"):
            height *= 1.3
        status = self._statuses.get(name)
        return _Box(kind, lines, height, _PLAIN if status is None else _COLOURS[status])

    def text(self) -> str:
        """Return the picture as SVG."""
        parts = [*self._arrows(), *(each for name in self._boxes for each in self._symbol(name))]
        size = (
            f'width="{self._width:.0f}" height="{self._height:.0f}" viewBox="0 0 {self._width:.0f} {self._height:.0f}"'
        )
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="Helvetica, sans-serif" font-size="12">'
            '<defs><marker id="supported" viewBox="0 0 10 10" refX="10" refY="5" markerWidth="9" markerHeight="9" '
            'orient="auto"><path d="M0 0L10 5L0 10z" fill="#37474f"/></marker>'
            '<marker id="context" viewBox="-1 -1 12 12" refX="10" refY="5" markerWidth="10" markerHeight="10" '
            'orient="auto"><path d="M0 0L10 5L0 10z" '
            'fill="#ffffff" stroke="#37474f"/></marker></defs><rect width="100%" height="100%" fill="#ffffff"/>'
        )
        return head + "".join(parts) + "</svg>\n"

    def _arrows(self) -> Iterator[str]:
        for name, argument in self._document.arguments.items():
            if name not in self._boxes:
                continue
            box = self._boxes[name]
            bottom = box.y + box.height
            for each in argument.by:
                to = self._boxes[each]
                middle = to.y - _DOWN / 2
                path = f"M{box.x:.1f} {bottom:.1f}V{middle:.1f}H{to.x:.1f}V{to.y - 1:.1f}"
                yield f'<path d="{path}" fill="none" stroke="#37474f" marker-end="url(#supported)"/>'
            for each in argument.context:
                to = self._boxes[each]
                start, end = box.x + _WIDTH / 2, to.x - _WIDTH / 2
                if end <= start:  # the context is drawn beside another element
                    start, end = box.x, to.x
                level = to.y + to.height / 2
                path = f"M{start:.1f} {box.y + box.height / 2:.1f}L{end - 1:.1f} {level:.1f}"
                yield f'<path d="{path}" fill="none" stroke="#37474f" marker-end="url(#context)"/>'

    def _symbol(self, name: str) -> Iterator[str]:
        box = self._boxes[name]
        left, right, bottom = box.x - _WIDTH / 2, box.x + _WIDTH / 2, box.y + box.height
        style = f'fill="{box.colours[0]}" stroke="{box.colours[1]}" stroke-width="1.6"'
        match box.kind:
            case "strategy":
                path = f"M{left + 14:.1f} {box.y:.1f}H{right:.1f}L{right - 14:.1f} {bottom:.1f}H{left:.1f}z"
                yield f'<path d="{path}" {style}/>'
            case "solution":
                yield f'<circle cx="{box.x:.1f}" cy="{box.y + box.height / 2:.1f}" r="{box.height / 2:.1f}" {style}/>'
            case "assumption" | "justification":
                middle = box.y + box.height / 2
                size = f'rx="{_WIDTH / 2}" ry="{box.height / 2:.1f}"'
                yield f'<ellipse cx="{box.x:.1f}" cy="{middle:.1f}" {size} {style}/>'
                mark = box.kind[0].upper()
                yield f'<text x="{right - 4:.1f}" y="{bottom:.1f}" font-weight="bold">{mark}</text>'
            case _:
                radius = 16 if box.kind == "context" else 0
                size = f'width="{_WIDTH}" height="{box.height:.1f}" rx="{radius}"'
                yield f'<rect x="{left:.1f}" y="{box.y:.1f}" {size} {style}/>'
        first = box.y + (box.height - len(box.lines) * _LINE) / 2 + 12
        for number, line in enumerate(box.lines):
            weight = ' font-weight="bold"' if number == 0 else ""
            y = first + number * _LINE
            yield f'<text x="{box.x:.1f}" y="{y:.1f}" text-anchor="middle"{weight}>{escape(line)}</text>'
        if box.kind == "goal" and not self._document.goals[name].by:  # undeveloped
            x, y = box.x, bottom
            yield f'<path d="M{x} {y}l8 8l-8 8l-8 -8z" fill="#ffffff" stroke="#37474f"/>'
