"""The fragment GR(1) of the language of specifications: initial conditions, safety, and recurring conditions.

A formula is split into clauses. Two patterns beyond the fragment are rewritten with a bit of memory, without a change
of meaning: ``always (p implies eventually q)`` and ``eventually p``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NoReturn

from symaware_cli.knowledge.synthesis.vocabulary import Vocabulary
from symaware_cli.specification import ExpressionError, parse
from symaware_cli.specification.node import NEXT, Constant, Junction, Node, Not, Temporal, walk

Kind = Literal["initial", "safety", "goal", "response", "once"]

#: The kinds of clauses that no finite part of a run refutes.
LIVENESS: tuple[Kind, ...] = ("goal", "response", "once")

_HINTS = {
    "until": "write what is to come as `eventually b`, and what is to stay as safety, such as `always (a or b)`",
    "since": "the past is not remembered; name what is to be remembered under `labels`",
    "once": "the past is not remembered; name what is to be remembered under `labels`",
    "historically": "the past is not remembered; name what is to be remembered under `labels`",
}


@dataclass(frozen=True)
class Clause:
    """A part of a formula, in the fragment.

    Attributes:
        kind: ``initial``: it holds at the beginning; ``safety``: at each step, where it may say `next`; ``goal``: again
            and again; ``response``: whenever `node` holds, `answer` holds then or later; ``once``: at some time.
        node: The condition.
        answer: The condition that answers a response.
    """

    kind: Kind
    node: Node
    answer: Node | None = None


def clauses(text: str, vocabulary: Vocabulary) -> tuple[Clause, ...]:
    """Split a formula into clauses.

    Args:
        text: The formula.
        vocabulary: The names that it may use.

    Raises:
        ExpressionError: It is not a valid formula, or outside the fragment; the message suggests an alternative.
    """
    found = tuple(_clauses(parse(text, vocabulary.names, {})))
    for clause in found:
        for node in (clause.node, clause.answer):
            if node is not None:
                vocabulary.compiled(node)
    return found


def _clauses(node: Node) -> Iterator[Clause]:
    if isinstance(node, Junction) and node.operator == "and":
        for each in node.operands:
            yield from _clauses(each)
        return
    if not isinstance(node, Temporal):
        _check(node, ())
        yield Clause("initial", node)
        return
    _check_operator(node)
    if node.operator == "always":
        yield from _always(node.operands[0])
    elif node.operator == "eventually":
        inner = node.operands[0]
        if isinstance(inner, Temporal) and inner.operator == "always":
            raise ExpressionError(
                "that something holds from some time on is outside GR(1): write `always p` if it can hold from the "
                "beginning, `always eventually p`, or let the strategy choose when it begins, with a product "
                '(docs/knowledge.md, "From some time on")',
                node.span,
            )
        _check(inner, ())
        yield Clause("once", inner)
    else:
        _refuse(node)


def _always(node: Node) -> Iterator[Clause]:
    if isinstance(node, Junction) and node.operator == "and":
        for each in node.operands:
            yield from _always(each)
        return
    if isinstance(node, Temporal) and node.operator == "eventually":
        _check_operator(node)
        _check(node.operands[0], ())
        yield Clause("goal", node.operands[0])
        return
    if isinstance(node, Junction) and node.operator == "implies":
        premise, conclusion = node.operands
        if isinstance(conclusion, Temporal) and conclusion.operator == "eventually":
            _check_operator(conclusion)
            _check(premise, ())
            _check(conclusion.operands[0], ())
            yield Clause("response", premise, conclusion.operands[0])
            return
    _check(node, NEXT)
    yield Clause("safety", node)


def _check_operator(node: Temporal) -> None:
    if node.window is not None:
        raise ExpressionError(
            f"a strategy goes from step to step, and a step has no fixed length in seconds: write `{node.operator}` "
            "without a window",
            node.span,
        )
    if node.operator in _HINTS:
        _refuse(node)


def _check(node: Node, allowed: tuple[str, ...]) -> None:
    """Check that a condition has no temporal operators but those allowed."""
    for each in walk(node):
        if isinstance(each, Temporal):
            _check_operator(each)
            if each.operator not in allowed:
                _refuse(each)


def _refuse(node: Temporal) -> NoReturn:
    hint = _HINTS.get(
        node.operator,
        "a formula is made of conditions at the beginning, `always p` where p may say `next`, `always eventually p`, "
        "`always (p implies eventually q)`, `eventually p`, and `and` between them",
    )
    raise ExpressionError(f"`{node.operator}` cannot stand here in GR(1): {hint}", node.span)


#: A condition that always holds.
TRUE = Constant((0, 0), True)


def negated(node: Node) -> Node:
    """Return the negation of a condition."""
    return Not(node.span, node)
