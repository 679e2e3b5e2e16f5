"""Operators and words of other languages, with their equivalents in expressions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from symaware_cli.specification.node import Span

#: Signs of other languages, the longest first.
_SIGNS: Mapping[str, str] = {
    **dict.fromkeys(("&&", "&", "∧", "/\\"), "and"),
    **dict.fromkeys(("||", "|", "∨", "\\/"), "or"),
    **dict.fromkeys(("!", "~", "¬"), "not"),
    **dict.fromkeys(("-->", "->", "==>", "=>", "→", "⇒", "⟶", "⟹"), "implies"),
    **dict.fromkeys(("[]", "□", "☐"), "always"),
    **dict.fromkeys(("<>", "◇", "♢", "⋄"), "eventually"),
    **dict.fromkeys(("○", "◯"), "next"),
    "≤": "<=",
    "≥": ">=",
    "=<": "<=",
    "≠": "!=",
    "===": "==",
    "=": "==",
    "−": "-",
    "×": "*",
    "·": "*",
    "÷": "/",
    "^": "**",
    "∞": "inf",
    ":": ",",
    ";": ",",
    **dict.fromkeys("“”„", '"'),
}
#: Signs of equivalence.
_EQUIVALENCE = ("<-->", "<->", "<=>", "↔", "⇔", "⟺", "≡")
_ALL = sorted((*_SIGNS, *_EQUIVALENCE), key=len, reverse=True)

#: Words of other languages; ours in other letters are known without being listed.
_WORDS: Mapping[str, str] = {
    **dict.fromkeys(("G", "globally", "henceforth"), "always"),
    **dict.fromkeys(("F", "finally", "future", "sometime"), "eventually"),
    "X": "next",
    "U": "until",
    "S": "since",
    "H": "historically",
    "O": "once",
    "N": "weak next",
    **dict.fromkeys(("imply", "then"), "implies"),
    "mod": "%",
}


class ForeignSign(NamedTuple):
    """A sign of another language in an expression.

    Attributes:
        length: Its length in characters.
        problem: What to write instead, in a sentence.
        span: The part of the expression that is to be replaced.
        correction: What to replace it by.
    """

    length: int
    problem: str
    span: Span
    correction: str


def foreign_sign(text: str, position: int) -> ForeignSign | None:
    """Return the sign of another language at a position of an expression; None if there is none."""
    sign = next((each for each in _ALL if text.startswith(each, position)), None)
    if sign is None:
        return None
    span = position, position + len(sign)
    if sign in _EQUIVALENCE:
        start, end = _brackets(text, position)
        one, other = text[start:position].strip(), text[span[1] : end].strip()
        both = f"(({one}) implies ({other})) and (({other}) implies ({one}))"
        problem = f"there is no `{sign}`: write `(a implies b) and (b implies a)`"
        return ForeignSign(len(sign), problem, (start, end), both)
    word = _SIGNS[sign]
    if sign == "<>" and text[:position].rstrip()[-1:].isalnum():
        word = "!="
    return ForeignSign(len(sign), f"write `{word}` instead of `{sign}`", span, apart(text, span, word))


def foreign_word(word: str, reserved: frozenset[str]) -> str | None:
    """Return the equivalent of a word of another language; None if there is none.

    Args:
        word: The word, which is not a known name.
        reserved: The words of this language.
    """
    plain = word.rstrip("_")
    return _WORDS.get(plain) or _WORDS.get(plain.lower()) or (plain.lower() if plain.lower() in reserved else None)


def apart(text: str, span: Span, word: str) -> str:
    """Return a word with a space on each side where it would touch another one."""
    if not word[0].isalpha():
        return word
    before, after = text[: span[0]][-1:], text[span[1] :][:1]
    left = before.isalnum() or before in ("_", ")", "]")
    return f"{' ' if left else ''}{word}{' ' if after.strip() and after != '[' else ''}"


def _brackets(text: str, position: int) -> Span:
    """Return the part of a text within the innermost brackets around a position."""
    depth, start = 0, position
    while start and (depth or text[start - 1] not in "(["):
        start -= 1
        depth += (text[start] in ")]") - (text[start] in "([")
    depth, end = 0, position
    while end < len(text) and (depth or text[end] not in ")]"):
        depth += (text[end] in "([") - (text[end] in ")]")
        end += 1
    return start, end
