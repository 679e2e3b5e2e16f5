"""Files of polygons: well-known text (OGC 06-103r4) and GeoJSON (RFC 7946), checked ring by ring.

Positions are metres in the plane of the world, not degrees. Outer rings run counter-clockwise and holes clockwise, as
both formats say.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import NoReturn

import numpy as np

from symaware_cli.geometry import LARGEST, Array
from symaware_cli.language import ScenarioError, Source, SourceNode, TextSpan, parse_yaml, quoted, read_text
from symaware_cli.maps.map_error import MapError

SUFFIXES = (".wkt", ".geojson")

#: The greatest number of corners of a file.
MOST_CORNERS = 20_000

_TOKEN = re.compile(r"\s*(?:([A-Za-z]+)|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|([(),;])|(\S))")
_DEPTH = 8


@dataclass(frozen=True)
class PolygonRing:
    """A closed ring of corners, the last equal to the first.

    Attributes:
        corners: The corners [m]; shape (k, 2).
        spans: The place of each corner in the file.
    """

    corners: Array
    spans: list[TextSpan]


class PolygonFile:
    """The polygons of a file.

    Attributes:
        polygons: The rings of each polygon: the outer ring, then holes.
        content: The content of the file.
    """

    def __init__(self, path: FilePath) -> None:
        """Read and check a file.

        Args:
            path: The file.

        Raises:
            ScenarioError: The file is invalid; contains the first problem of each polygon with its place in the file.
            MapError: shapely is not installed.
        """
        self.polygons: list[list[PolygonRing]] = []
        suffix = path.suffix.lower()
        self._source = source = read_text(path, str(path), "a file of polygons", SUFFIXES)
        if not source.problems and suffix == ".geojson":
            # JSON is YAML in flow style, except for tabs.
            source.text = source.text.replace("\t", " ")
            parse_yaml(source)
        self._raise()
        self.content = path.read_bytes()
        found = self._well_known() if suffix == ".wkt" else self._geometries(source.root)
        count = 0
        for rings in found:
            count += sum(len(ring.spans) for ring in rings)
            if count > MOST_CORNERS:
                self._refuse(f"the file has more than {MOST_CORNERS:,} corners", rings[0].spans[0])
            if self._is_sound(rings):
                self.polygons.append(rings)
        self._raise()
        if not self.polygons:
            self._refuse("the file has no polygons", source.text_span(1, 1, 1, 2))

    def _raise(self) -> None:
        if self._source.problems:
            raise ScenarioError(self._source.problems)

    def _refuse(self, message: str, span: TextSpan) -> NoReturn:
        self._source.report("unsuitable", message, span)
        raise ScenarioError(self._source.problems)

    # -- checks

    def _is_sound(self, rings: list[PolygonRing]) -> bool:
        """Check a polygon; report its first problem."""
        for number, ring in enumerate(rings):
            said = self._fault(ring, is_outer=number == 0)
            if said is not None:
                self._source.report("unsuitable", said[0], said[1])
                return False
        try:
            import shapely
        except ImportError as error:
            raise MapError("polygons need shapely: pip install 'symaware-cli[maps]'") from error
        polygon = shapely.Polygon(rings[0].corners, [ring.corners for ring in rings[1:]])
        if not polygon.is_valid:
            reason = re.sub(r"\[(.*)\]", r" at (\1)", str(shapely.is_valid_reason(polygon)))
            self._source.report("unsuitable", f"the polygon is invalid: {reason.lower()}", rings[0].spans[0])
            return False
        return True

    def _fault(self, ring: PolygonRing, is_outer: bool) -> tuple[str, TextSpan] | None:
        corners = ring.corners
        if len(corners) < 4:
            return f"a ring has at least 4 positions, the last equal to the first, not {len(corners)}", ring.spans[0]
        wrong = np.flatnonzero(~(np.abs(corners) <= LARGEST).all(axis=1))
        if len(wrong):
            return f"a coordinate is not a number from {-LARGEST:g} to {LARGEST:g}", ring.spans[int(wrong[0])]
        if (corners[0] != corners[-1]).any():
            return "the ring is not closed: its last position is not its first", ring.spans[-1]
        same = np.flatnonzero((corners[1:] == corners[:-1]).all(axis=1))
        if len(same):
            return "the position is that of the corner before it", ring.spans[int(same[0]) + 1]
        x, y = (corners - corners[0]).T
        if (float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) > 0.0) != is_outer:
            ways = ("counter-clockwise", "clockwise") if is_outer else ("clockwise", "counter-clockwise")
            kind = "an outer ring" if is_outer else "a hole"
            return f"{kind} runs {ways[0]}, this one {ways[1]}", ring.spans[0]
        return None

    # -- GeoJSON

    def _geometries(self, node: SourceNode | None, depth: int = 0) -> Iterator[list[PolygonRing]]:
        """Yield the polygons of a GeoJSON object."""
        if node is None or not isinstance(node.value, dict):
            span = node.span if node is not None else self._source.text_span(1, 1, 1, 2)
            self._refuse("a GeoJSON object is a mapping with a `type`", span)
        entries = node.value
        kind = entries["type"].node.value if "type" in entries else None
        inner = {
            "FeatureCollection": "features",
            "GeometryCollection": "geometries",
            "Feature": "geometry",
            "Polygon": "coordinates",
            "MultiPolygon": "coordinates",
        }.get(str(kind))
        if inner is None or depth > _DEPTH:
            span = entries["type"].node.span if "type" in entries else node.span
            shown = "an object without a type" if kind is None else f"a {quoted(str(kind))}"
            self._refuse(f"{shown} is none of polygons, multipolygons, and their collections", span)
        if inner not in entries:
            self._refuse(f"a {kind} has {quoted(inner)}", node.span)
        content = entries[inner].node
        if kind == "Feature":
            yield from self._geometries(content, depth + 1)
        elif kind == "Polygon":
            yield self._polygon(content)
        else:
            for each in self._listed(content):
                yield from [self._polygon(each)] if kind == "MultiPolygon" else self._geometries(each, depth + 1)

    def _listed(self, node: SourceNode) -> list[SourceNode]:
        if not isinstance(node.value, list) or not node.value:
            self._refuse("a list with something in it is needed", node.span)
        return node.value

    def _polygon(self, node: SourceNode) -> list[PolygonRing]:
        rings = []
        for ring in self._listed(node):
            corners, spans = [], []
            for place in self._listed(ring):
                numbers = [each.value for each in self._listed(place)]
                if len(numbers) != 2 or any(isinstance(n, bool) or not isinstance(n, int | float) for n in numbers):
                    self._refuse("a position is two numbers [m]", place.span)
                corners.append([float(n) for n in numbers if isinstance(n, int | float)])
                spans.append(place.span)
            rings.append(PolygonRing(np.array(corners), spans))
        return rings

    # -- well-known text

    def _well_known(self) -> Iterator[list[PolygonRing]]:
        """Yield the polygons of well-known text: geometries one after the other."""
        tokens = _Tokens(self._source)
        while tokens.kind:
            if not tokens.skipped(";"):
                yield from self._geometry(tokens)

    def _geometry(self, tokens: _Tokens, depth: int = 0) -> Iterator[list[PolygonRing]]:
        kind, span = tokens.text.upper(), tokens.span
        if kind not in ("POLYGON", "MULTIPOLYGON", "GEOMETRYCOLLECTION") or depth > _DEPTH:
            said = "is none of POLYGON, MULTIPOLYGON and GEOMETRYCOLLECTION"
            self._refuse(f"{quoted(tokens.text) if tokens.text else 'the end of the file'} {said}", span)
        tokens.advance()
        if tokens.text.upper() == "EMPTY":
            tokens.advance()
        elif kind == "POLYGON":
            yield [self._ring(tokens) for _ in self._members(tokens)]
        elif kind == "MULTIPOLYGON":
            for _ in self._members(tokens):
                yield [self._ring(tokens) for _ in self._members(tokens)]
        else:
            for _ in self._members(tokens):
                yield from self._geometry(tokens, depth + 1)

    def _ring(self, tokens: _Tokens) -> PolygonRing:
        corners, spans = [], []
        for _ in self._members(tokens):
            spans.append(tokens.span)
            numbers = []
            while tokens.kind == "number":
                numbers.append(float(tokens.text))
                tokens.advance()
            if len(numbers) != 2 or tokens.kind == "word":
                self._refuse("a position is two numbers [m]", spans[-1])
            corners.append(numbers)
        return PolygonRing(np.array(corners), spans)

    def _members(self, tokens: _Tokens) -> Iterator[None]:
        """Step through a list in parentheses; the caller reads each member."""
        self._expect(tokens, "(")
        yield
        while tokens.skipped(","):
            yield
        self._expect(tokens, ")")

    def _expect(self, tokens: _Tokens, sign: str) -> None:
        if not tokens.skipped(sign):
            shown = quoted(tokens.text) if tokens.text else "the end of the file"
            self._refuse(f"there should be `{sign}` here, not {shown}", tokens.span)


class _Tokens:
    """The tokens of well-known text.

    Attributes:
        kind: The kind of the present token: word, number, sign, other; empty at the end.
        text: The text of the present token.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._place = 0
        self._lines = [0, *(found.end() for found in re.finditer("\r\n|\n|\r", source.text))]
        self.kind = self.text = ""
        self._start = 0
        self.advance()

    @property
    def span(self) -> TextSpan:
        """The place of the present token."""
        line = bisect_right(self._lines, self._start)
        column = self._start - self._lines[line - 1] + 1
        return self._source.text_span(line, column, line, column + max(1, len(self.text)))

    def advance(self) -> None:
        """Go to the next token."""
        found = _TOKEN.match(self._source.text, self._place)
        if found is None:
            self.kind = self.text = ""
            self._start = max(0, len(self._source.text.rstrip()) - 1)
            return
        self.kind = ("word", "number", "sign", "other")[(found.lastindex or 1) - 1]
        self.text = found[found.lastindex or 1]
        self._start, self._place = found.start(found.lastindex or 1), found.end()

    def skipped(self, sign: str) -> bool:
        """Skip the present token if it is a given sign; return whether it was."""
        if self.kind != "sign" or self.text != sign:
            return False
        self.advance()
        return True
