"""Parser of expressions: turns text into a syntax tree, with one grammar for conditions and specifications.

It is an operator-precedence parser; `PRECEDENCE` is its table. Work and memory are bounded by the length of the text.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from typing import Literal, NamedTuple, NoReturn, TypeAlias, cast

from symaware_cli.specification.node import (
    FUTURE,
    NEXT,
    PAST,
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Element,
    Junction,
    Name,
    Node,
    Not,
    Sign,
    Span,
    Temporal,
    Vector,
    moved,
)
from symaware_cli.specification.notation import apart, foreign_word
from symaware_cli.specification.token import ExpressionError, Token, tokens

#: Maximum length of an expression, in characters.
LONGEST = 2_000
#: Maximum depth of nested brackets; keeps every tree within Python's recursion limit.
_DEEPEST = 30

#: Binary operators by precedence: a later row binds more tightly.
PRECEDENCE: tuple[tuple[str, ...], ...] = (
    ("implies",),
    ("or",),
    ("and",),
    ("until", "since"),
    ("not", "always", "eventually", "next", "weak next", "historically", "once"),  # before their operand
    ("<", "<=", ">", ">=", "==", "!="),
    ("+", "-"),
    ("*", "/", "%"),
    ("sign",),  # - and + before their operand
    ("**",),
)
LEVEL: Mapping[str, int] = {operator: level for level, row in enumerate(PRECEDENCE) for operator in row}
_COMPARISONS = PRECEDENCE[LEVEL["<"]]
_TEMPORAL = frozenset((*FUTURE, *PAST))
#: Words that cannot be names.
RESERVED = frozenset((*_TEMPORAL, "implies", "and", "or", "not", "true", "false", "True", "False", "None"))
#: A name with hyphens, which an expression reads as differences.
_HYPHENS = re.compile(r"[A-Za-z_]\w*(?:-[A-Za-z0-9_]+)+")
#: Python keywords without a meaning here, each with the error message.
_FOREIGN: Mapping[str, str] = {
    "is": "the comparisons are <, <=, >, >=, == and !=",
    "in": "the comparisons are <, <=, >, >=, == and !=",
    "if": "there is no `if` in an expression; write `a implies b`",
    "for": "there are no loops in an expression",
    "lambda": "functions cannot be defined in an expression",
}
#: Names that only some agents have, each with the error message where there are none.
_ELSEWHERE: Mapping[str, str] = {
    "link": "there are no links here: `link` is of robots from files whose model drives their joints",
}
_CONSTANTS: Mapping[str, bool | None] = {"true": True, "True": True, "false": False, "False": False, "None": None}


class Keys(NamedTuple):
    """The valid keys in brackets after a name, as in ``position["robot.2"]``.

    Attributes:
        kind: The kind of object that a key names: ``agent``, ``specification``, ...
        names: The valid keys; in a mapping, with the keys that must follow them.
        refused: Further keys, each with the reason why it is not valid.
        is_joined: Whether the name and a key stand for the name that they form with an underscore between them:
            ``lane("2")`` for ``lane_2``.
        is_optional: Whether the name may stand without a key.
    """

    kind: str
    names: Collection[str] | Mapping[str, Keys]
    refused: Mapping[str, str] = {}
    is_joined: bool = False
    is_optional: bool = False


#: The names that an expression may refer to, each with the keys that must follow it in brackets; None for no key.
Names: TypeAlias = Mapping[str, Keys | None]


def parse(
    text: str,
    names: Collection[str] | Names,
    functions: Mapping[str, int | None],
    definitions: Mapping[str, Node] | None = None,
    longest: int = LONGEST,
) -> Node:
    """Parse an expression.

    Args:
        text: The expression.
        names: The names it may refer to; in `Names`, with the keys that must follow them.
        functions: The functions it may call, each with its number of arguments; None for any number but 0.
        definitions: Syntax trees by name; a name in the text is replaced by its tree.
        longest: Maximum length in characters.

    Raises:
        ExpressionError: The expression is not valid; the error has the position.
    """
    if len(text) > longest:
        raise ExpressionError(f"an expression has at most {longest} characters, not {len(text)}", (0, len(text)))
    if not text.strip():
        raise ExpressionError("the expression is empty", (0, len(text)))
    return _Parser(text, names, functions, definitions or {}).parse()


class _Parser:
    def __init__(
        self,
        text: str,
        names: Collection[str] | Names,
        functions: Mapping[str, int | None],
        definitions: Mapping[str, Node],
    ) -> None:
        self._text = text
        self._names = names
        keys = names.items() if isinstance(names, Mapping) else ()
        self._keys = {name: each for name, each in keys if isinstance(each, Keys)}
        self._functions = functions
        self._definitions = definitions
        # One token of lookahead: an invalid token is reported only after the errors that precede it.
        self._tokens = tokens(text)
        self._next = next(self._tokens)
        self._depth = 0

    def parse(self) -> Node:
        node = self._expression(0)
        token = self._next
        if token.kind != "end":
            raise self._unexpected(token)
        return node

    # Tokens

    def _take(self) -> Token:
        token = self._next
        if token.kind != "end":
            self._next = next(self._tokens)
        return token

    def _is(self, *texts: str) -> bool:
        return self._next.kind in ("word", "operator") and self._next.text in texts

    def _expect(self, text: str, what: str) -> Token:
        if not self._is(text):
            raise ExpressionError(f"{what} lacks its `{text}`", self._spot(self._next))
        return self._take()

    def _spot(self, token: Token) -> Span:
        """Return the span of a token; for the end, the last character."""
        start, end = token.span
        return (start, end) if end > start else (max(0, start - 1), start)

    def _unexpected(self, token: Token) -> ExpressionError:
        span = self._spot(token)
        if token.kind == "end":
            return ExpressionError("the expression breaks off here", span)
        if token.kind == "word" and token.text in _FOREIGN:
            return ExpressionError(_FOREIGN[token.text], span)
        if (foreign := self._foreign(token)) is not None:
            return foreign
        return ExpressionError(f"`{token.text}` cannot stand here: an operator is missing before it", span)

    def _foreign(self, token: Token) -> ExpressionError | None:
        """Return the error for a word of another language; None for any other word."""
        word = foreign_word(token.text, RESERVED) if token.kind == "word" else None
        if word is None or word == token.text:
            return None
        said = f"write `{word}` instead of `{token.text}`"
        return ExpressionError(said, token.span, correction=apart(self._text, token.span, word))

    # Expressions

    def _expression(self, level: int) -> Node:
        """Parse an expression whose operators bind at least as tightly as a level of `PRECEDENCE`."""
        self._depth += 1
        if self._depth > _DEEPEST * len(PRECEDENCE):
            raise ExpressionError("the expression is nested too deeply", self._spot(self._next))
        try:
            return _LEVELS[level](self, level)
        finally:
            self._depth -= 1

    def _binary(self, level: int) -> tuple[Node, Token] | Node:
        left = self._expression(level + 1)
        return (left, self._take()) if self._is(*PRECEDENCE[level]) else left

    def _implication(self, level: int) -> Node:
        found = self._binary(level)
        if isinstance(found, Node):
            return found
        left, right = found[0], self._expression(level)  # right-associative
        return Junction(_joined(left, right), "implies", (left, right))

    def _junction(self, level: int) -> Node:
        operator = cast("Literal['and', 'or']", PRECEDENCE[level][0])
        operands = [self._expression(level + 1)]
        while self._is(operator):
            self._take()
            operands.append(self._expression(level + 1))
        if len(operands) == 1:
            return operands[0]
        return Junction(_joined(operands[0], operands[-1]), operator, tuple(operands))

    def _until(self, level: int) -> Node:
        found = self._binary(level)
        if isinstance(found, Node):
            return found
        left, token = found
        window = self._window(token)
        right = self._expression(level)  # right-associative
        return Temporal(_joined(left, right), token.text, window, (left, right))

    def _prefix(self, level: int) -> Node:
        if not self._is(*PRECEDENCE[level]):
            return self._expression(level + 1)
        token = self._take()
        window = None
        if token.text != "not":
            window = self._window(token)
            if window is not None and token.text in NEXT:
                raise ExpressionError(f"`{token.text}` has no window: it is about the next step", token.span)
        operand = self._expression(level)
        span = (token.span[0], operand.span[1])
        return Not(span, operand) if token.text == "not" else Temporal(span, token.text, window, (operand,))

    def _comparison(self, level: int) -> Node:
        operands, operators = [self._expression(level + 1)], []
        while self._is(*_COMPARISONS):
            operators.append(self._take().text)
            operands.append(self._expression(level + 1))
        if not operators:
            return operands[0]
        return Comparison(_joined(operands[0], operands[-1]), tuple(operators), tuple(operands))

    def _arithmetic(self, level: int) -> Node:
        left = self._expression(level + 1)
        while self._is(*PRECEDENCE[level]):
            operator = cast("Literal['+', '-', '*', '/', '%']", self._take().text)
            right = self._expression(level + 1)
            left = Arithmetic(_joined(left, right), operator, left, right)
        return left

    def _signed(self, level: int) -> Node:
        if not self._is("-", "+"):
            return self._expression(level + 1)
        token = self._take()
        operand = self._expression(level)
        sign = cast("Literal['+', '-']", token.text)
        return Sign((token.span[0], operand.span[1]), sign, operand)

    def _power(self, level: int) -> Node:
        left = self._operand()
        if not self._is("**"):
            return left
        self._take()
        right = self._expression(level - 1)  # right-associative; the exponent may have a sign
        return Arithmetic(_joined(left, right), "**", left, right)

    # Operands

    def _operand(self) -> Node:
        node = self._atom()
        keys = self._keys.get(node.name) if isinstance(node, Name) else None
        while True:
            if keys is not None and not keys.is_optional and not self._is("[", "."):
                said = self._text[slice(*node.span)]
                raise ExpressionError(f"say {_which(keys)}: {said}{_example(keys)}", node.span)
            if not self._is("[", "."):
                return node
            key: int | str
            if self._take().text == ".":
                end = self._take()
                if end.kind != "word":
                    said = 'a name is missing after the dot; other keys are written in brackets, such as [0] or ["a-b"]'
                    raise ExpressionError(said, self._spot(end))
                key, place = end.text, end
            else:
                place = self._next
                key = self._key()
                end = self._expect("]", "the index")
            if keys is not None:
                if key not in keys.names:
                    self._refuse_key(self._text[slice(*node.span)], key, keys, place)
                if keys.is_joined and isinstance(node, Name):
                    node = Name((node.span[0], end.span[1]), f"{node.name}_{key}")
                    keys = self._keys.get(node.name)
                    continue
                following = keys.names[str(key)] if isinstance(keys.names, Mapping) else None
                keys = following if isinstance(following, Keys) else None
            node = Element((node.span[0], end.span[1]), node, key)

    def _refuse_key(self, name: str, key: int | str, keys: Keys, place: Token) -> NoReturn:
        if isinstance(key, int):
            raise ExpressionError(f"`{name}` takes a name in quotes: {name}{_example(keys)}", place.span)
        if key in keys.refused:
            raise ExpressionError(keys.refused[key], place.span)
        said, quotes = f"there is no {keys.kind} `{key}`", place.kind == "text"
        raise ExpressionError(said, place.span, key, keys.names, quotes=quotes)

    def _atom(self) -> Node:
        token = self._take()
        if token.kind == "number":
            return Constant(token.span, _number(token))
        if token.kind == "text":
            return Constant(token.span, token.text[1:-1])
        if token.kind == "word":
            return self._word(token)
        if token.text in ("(", "["):
            return self._brackets(token)
        if token.kind == "end":
            raise self._unexpected(token)
        raise ExpressionError(f"`{token.text}` cannot stand here: a value is missing before it", token.span)

    def _word(self, token: Token) -> Node:
        name = token.text
        if name in _CONSTANTS:
            return Constant(token.span, _CONSTANTS[name])
        if name in PRECEDENCE[LEVEL["not"]]:
            said = f"`{name}` cannot stand after an operator that binds more tightly: put it in brackets, ({name} ...)"
            raise ExpressionError(said, token.span)
        if name in RESERVED:
            raise ExpressionError(f"`{name}` cannot stand here: a value is missing before it", token.span)
        if name in _FOREIGN:
            raise ExpressionError(_FOREIGN[name], token.span)
        if self._is("("):
            return self._of_whom(token) if name in self._keys.keys() - self._definitions else self._call(token)
        if name in self._definitions:
            return moved(self._definitions[name], token.span)
        if name in self._names:
            return Name(token.span, name)
        if name in self._functions:
            raise ExpressionError(f"`{name}` is a function: write {name}(...)", token.span)
        if (foreign := self._foreign(token)) is not None:
            raise foreign
        if name in _ELSEWHERE:
            raise ExpressionError(_ELSEWHERE[name], token.span)
        said = f"there is no `{name}` here"
        whole = _HYPHENS.match(self._text, token.span[0])
        if whole is not None:
            said += f', and - is a minus: names with a hyphen are texts, as in position["{whole.group()}"]'
        raise ExpressionError(said, token.span, name, {*self._names, *self._definitions})

    def _brackets(self, token: Token) -> Node:
        closing = ")" if token.text == "(" else "]"
        items = self._items(closing)
        end = self._expect(closing, "the bracket")
        span = (token.span[0], end.span[1])
        if closing == ")" and len(items) == 1:
            return items[0]
        if not items:
            raise ExpressionError("the brackets are empty", span)
        return Vector(span, tuple(items))

    def _items(self, closing: str) -> list[Node]:
        items: list[Node] = []
        while not self._is(closing):
            items.append(self._expression(0))
            if not self._is(","):
                break
            self._take()
        return items

    def _call(self, token: Token) -> Node:
        name = token.text
        if name not in self._functions:
            if (foreign := self._foreign(token)) is not None:
                raise foreign
            if name in self._keys:
                said = f"`{name}` takes a name in brackets: {name}{_example(self._keys[name])}"
                raise ExpressionError(said, token.span)
            if name in _ELSEWHERE:
                raise ExpressionError(_ELSEWHERE[name], token.span)
            called = [*self._functions, *(each for each, keys in self._keys.items() if not keys.is_optional)]
            raise ExpressionError(f"there is no function `{name}`", token.span, name, called)
        self._take()
        arguments = self._items(")")
        span = (token.span[0], self._expect(")", f"{name}(...)").span[1])
        count = self._functions[name]
        if len(arguments) != count if count is not None else not arguments:
            wanted = "at least 1 argument" if count is None else f"{count} argument{'s' if count > 1 else ''}"
            raise ExpressionError(f"{name}(...) takes {wanted}, not {len(arguments)}", span)
        return Call(span, name, tuple(arguments))

    def _of_whom(self, token: Token) -> Node:
        """Parse a name with its keys in round brackets: ``belief(other)`` is ``belief["other"]``."""
        name, keys = token.text, cast("Keys | None", self._keys[token.text])
        self._take()
        found: list[str] = []
        while keys is not None:
            place = self._take()
            if place.kind not in ("word", "text"):
                shown = ", ".join([*found, next(iter(keys.names), "...")])
                raise ExpressionError(f"say {_which(keys)}: {name}({shown})", self._spot(place))
            key = place.text if place.kind == "word" else place.text[1:-1]
            if key not in keys.names:
                self._refuse_key(name, key, keys, place)
            found.append(key)
            following = keys.names[key] if isinstance(keys.names, Mapping) else None
            keys = following if isinstance(following, Keys) else None
            if keys is not None:
                self._expect(",", f"{name}(...)")
        end = self._expect(")", f"{name}(...)")
        if self._keys[name].is_joined:
            return Name((token.span[0], end.span[1]), "_".join([name, *found]))
        node: Node = Name(token.span, name)
        for key in found:
            node = Element((token.span[0], end.span[1]), node, key)
        return node

    def _key(self) -> int | str:
        sign = -1 if self._is("-") else 1
        if sign < 0:
            self._take()
        token = self._take()
        if token.kind == "text" and sign > 0:
            return token.text[1:-1]
        if token.kind == "number" and token.text.isdecimal():
            return sign * int(token.text)
        said = 'an element is named by a number or a text, such as state[0] or knowledge["goal"]'
        raise ExpressionError(said, self._spot(token))

    # Windows

    def _window(self, operator: Token) -> tuple[float, float] | None:
        """Parse the window after a temporal operator, if present: ``[0, 5]`` or ``[2, inf]``."""
        if not self._is("["):
            return None
        start = self._take().span[0]
        said = f"a window is two times in seconds: {operator.text}[0, 5] or {operator.text}[2, inf]"
        bounds = []
        for separator in (",", "]"):
            token = self._take()
            if token.kind == "number":
                bounds.append(_number(token))
            elif token.text == "inf" and separator == "]":
                bounds.append(math.inf)
            elif token.text == "-":
                raise ExpressionError(
                    "a window begins at 0 at the earliest; the past has operators of its own: once, "
                    "historically, since",
                    self._spot(token),
                )
            else:
                raise ExpressionError(said, self._spot(token))
            if not self._is(separator):
                raise ExpressionError(said, self._spot(self._next))
            end = self._take().span[1]
        if bounds[0] > bounds[1]:
            raise ExpressionError("the window ends before it begins", (start, end))
        return bounds[0], bounds[1]


#: The method for each row of `PRECEDENCE`.
_LEVELS: tuple[Callable[[_Parser, int], Node], ...] = (
    _Parser._implication,
    _Parser._junction,
    _Parser._junction,
    _Parser._until,
    _Parser._prefix,
    _Parser._comparison,
    _Parser._arithmetic,
    _Parser._arithmetic,
    _Parser._signed,
    _Parser._power,
)


def _which(keys: Keys) -> str:
    return "which" if keys.kind == "link" or keys.is_joined else "whose"


def _example(keys: Keys) -> str:
    if not keys.names:
        return f'["..."], but there is no {keys.kind}'
    first = next(iter(keys.names))
    following = keys.names[first] if isinstance(keys.names, Mapping) else None
    return f'["{first}"]{_example(following) if isinstance(following, Keys) else ""}'


def _joined(first: Node, last: Node) -> Span:
    return first.span[0], last.span[1]


def _number(token: Token) -> float:
    try:
        number = float(token.text)
    except ValueError:
        raise ExpressionError(f"`{token.text}` is not a number", token.span) from None
    if not math.isfinite(number):
        raise ExpressionError("the number is too large", token.span)
    return number
