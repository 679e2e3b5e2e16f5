"""Reads directed graphs in the language DOT of Graphviz, with the place of each node and edge."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, NoReturn

#: The greatest nesting of subgraphs.
_DEEPEST = 32

_TOKEN = re.compile(
    r"""(?P<space>[\s\ufeff]+|//[^\n]*|/\*.*?\*/)
    |(?P<mark>->|--|[{}\[\];,=:+])
    |(?P<quoted>"(?:[^"\\]|\\.)*")
    |(?P<number>-?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?))
    |(?P<word>[A-Za-z_\u0080-\uffff][A-Za-z_0-9\u0080-\uffff]*)""",
    re.VERBOSE | re.DOTALL,
)
_KEYWORDS = ("strict", "graph", "digraph", "node", "edge", "subgraph")


class DotError(ValueError):
    """A text is no directed graph in DOT.

    Attributes:
        line: The line of the problem, from 1.
        column: The column of the problem, from 1.
    """

    def __init__(self, message: str, line: int, column: int) -> None:
        super().__init__(message)
        self.line = line
        self.column = column


class DotToken(NamedTuple):
    """A token; its kind is ``mark``, ``keyword``, ``id`` or ``end``."""

    kind: str
    text: str
    line: int
    column: int

    def refuse(self, message: str) -> NoReturn:
        """Refuse the text for a problem at this token.

        Raises:
            DotError: Always.
        """
        raise DotError(message, self.line, self.column)


@dataclass
class DotGraph:
    """A directed graph.

    Attributes:
        is_strict: Whether several edges from one node to another are one.
        nodes: The nodes in the order in which they appear, each with its attributes.
        edges: The edges in the order in which they appear, each with the token at which it begins.
        tokens: Where each node appears first.
    """

    is_strict: bool = False
    nodes: dict[str, dict[str, str]] = field(default_factory=dict)
    edges: list[tuple[str, str, DotToken]] = field(default_factory=list)
    tokens: dict[str, DotToken] = field(default_factory=dict)


def read_dot(text: str) -> DotGraph:
    """Read a graph (the grammar is that of "DOT Language" in Graphviz's documentation).

    Ports, and attributes of graphs and edges, are read and ignored. Defaults of nodes apply to those that follow.

    Raises:
        DotError: The text is no such graph.
    """
    return _Reader(text).read()


class _Reader:
    def __init__(self, text: str) -> None:
        self._tokens = list(_tokens(text))
        self._at = 0
        self._graph = DotGraph()

    def read(self) -> DotGraph:
        self._graph.is_strict = self._takes("strict")
        begin = self._now
        if self._takes("graph"):
            begin.refuse("a transition system is a directed graph, a `digraph`")
        self._expect("digraph")
        if self._now.kind == "id":
            self._identifier()
        self._expect("{")
        self._statements({}, 0)
        if self._now.kind != "end":
            self._now.refuse(f"{_shown(self._now)} follows the end of the graph")
        return self._graph

    # -- statements

    def _statements(self, defaults: dict[str, str], depth: int) -> list[str]:
        """Read statements up to the closing brace; returns the nodes in them."""
        if depth > _DEEPEST:
            self._now.refuse(f"subgraphs are nested more than {_DEEPEST} deep")
        within: list[str] = []
        while not self._takes("}"):
            if self._now.kind == "end":
                self._now.refuse("a `}` is missing at the end of the graph")
            if not self._takes(";"):
                within += self._statement(defaults, depth)
        return within

    def _statement(self, defaults: dict[str, str], depth: int) -> Sequence[str]:
        if self._now.kind == "keyword" and self._now.text in ("graph", "node", "edge"):
            kind = self._next().text
            attributes = self._attributes()
            if kind == "node":
                defaults.update(attributes)
            return ()
        if self._now.kind == "id" and self._ahead.text == "=" and self._ahead.kind == "mark":
            self._identifier()
            self._next()
            self._identifier()
            return ()
        begin, is_node = self._now, self._now.kind == "id"
        ends = [self._end(defaults, depth)]
        starts = [begin]
        while self._now.kind == "mark" and self._now.text in ("->", "--"):
            if self._next().text == "--":
                starts[-1].refuse("an edge of a `digraph` is written with `->`")
            starts.append(self._now)
            ends.append(self._end(defaults, depth))
        attributes = self._attributes()
        for place in range(len(ends) - 1):
            edges = [(one, other) for one in ends[place] for other in ends[place + 1]]
            self._graph.edges += [(one, other, starts[place]) for one, other in edges]
        if len(ends) == 1 and is_node:
            self._graph.nodes[ends[0][0]].update(attributes)
        return [name for each in ends for name in each]

    def _end(self, defaults: dict[str, str], depth: int) -> list[str]:
        """Read a node or a subgraph, an end of an edge; returns its nodes, each once."""
        if self._takes("subgraph") and self._now.kind == "id":
            self._identifier()
        if self._takes("{"):
            return list(dict.fromkeys(self._statements(dict(defaults), depth + 1)))
        token = self._now
        name = self._identifier()
        for _ in range(2):  # a port, and a side of it
            if self._takes(":"):
                self._identifier()
        if name not in self._graph.nodes:
            self._graph.nodes[name] = dict(defaults)
            self._graph.tokens[name] = token
        return [name]

    def _attributes(self) -> dict[str, str]:
        found: dict[str, str] = {}
        while self._takes("["):
            while not self._takes("]"):
                name = self._identifier()
                found[name] = self._identifier() if self._takes("=") else "true"
                if not self._takes(","):
                    self._takes(";")
        return found

    # -- tokens

    @property
    def _now(self) -> DotToken:
        return self._tokens[self._at]

    @property
    def _ahead(self) -> DotToken:
        return self._tokens[min(self._at + 1, len(self._tokens) - 1)]

    def _next(self) -> DotToken:
        token = self._now
        self._at = min(self._at + 1, len(self._tokens) - 1)
        return token

    def _takes(self, text: str) -> bool:
        if self._now.kind in ("mark", "keyword") and self._now.text == text:
            self._next()
            return True
        return False

    def _expect(self, text: str) -> None:
        if not self._takes(text):
            self._now.refuse(f"`{text}` is expected here, not {_shown(self._now)}")

    def _identifier(self) -> str:
        if self._now.kind != "id":
            self._now.refuse(f"a name is expected here, not {_shown(self._now)}")
        name = self._next().text
        while self._takes("+"):  # joins quoted texts
            if self._now.kind != "id":
                self._now.refuse(f"a quoted text is expected here, not {_shown(self._now)}")
            name += self._next().text
        return name


def _tokens(text: str) -> Iterator[DotToken]:
    """Yield the tokens of a text, and one for its end."""
    at, line, start = 0, 1, 0
    while at < len(text):
        column = at - start + 1
        if text[at] == "#" and not text[start:at].strip():
            found = re.compile(r"[^\n]*").match(text, at)  # a line of the C preprocessor
            assert found is not None
            end = found.end()
        elif text[at] == "<":
            end = _markup_end(text, at, line, column)
            yield DotToken("id", text[at:end], line, column)
        else:
            matched = _TOKEN.match(text, at)
            if matched is None:
                said = f"`{text[at]}` cannot stand here"
                if text[at] == '"':
                    said = "this text is never closed with a quote"
                elif text.startswith("/*", at):
                    said = "this comment is never closed"
                raise DotError(said, line, column)
            end, kind, written = matched.end(), matched.lastgroup, matched.group()
            if kind == "quoted":
                yield DotToken("id", re.sub(r"\\\r?\n", "", written[1:-1]).replace('\\"', '"'), line, column)
            elif kind == "word" and written.lower() in _KEYWORDS:
                yield DotToken("keyword", written.lower(), line, column)
            elif kind != "space":
                yield DotToken("mark" if kind == "mark" else "id", written, line, column)
        breaks = text.count("\n", at, end)
        if breaks:
            line, start = line + breaks, text.rindex("\n", at, end) + 1
        at = end
    yield DotToken("end", "", line, len(text) - start + 1)


def _markup_end(text: str, at: int, line: int, column: int) -> int:
    """Return where a text in `<` and `>` ends, in which these are nested."""
    depth = 0
    for place in range(at, len(text)):
        depth += {"<": 1, ">": -1}.get(text[place], 0)
        if depth == 0:
            return place + 1
    raise DotError("this text is never closed with `>`", line, column)


def _shown(token: DotToken) -> str:
    return "the end" if token.kind == "end" else f"`{token.text[:40]}`"
