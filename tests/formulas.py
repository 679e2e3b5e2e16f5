"""Random formulas and signals."""

from collections.abc import Sequence

import numpy as np

from symaware_cli.specification.formula import (
    Always,
    And,
    Array,
    Constant,
    Eventually,
    Formula,
    Historically,
    Next,
    Not,
    Once,
    Or,
    Predicate,
    Since,
    Until,
    encoded,
)

PREDICATES = 3


def random_formula(
    generator: np.random.Generator,
    depth: int,
    *,
    widest: int = 3,
    past: bool = True,
    unbounded: bool = True,
    constants: bool = True,
    limits: bool = True,
    nexts: bool = True,
) -> Formula:
    """A formula with a greatest depth of nested operators.

    Args:
        generator: Draws it.
        depth: The greatest depth.
        widest: The greatest beginning of windows, and their greatest number of instants.
        past: Whether operators look back, too.
        unbounded: Whether windows may have no end.
        constants: Whether there are constants.
        limits: Whether windows without an end may begin later.
        nexts: Whether there are `next` and `weak next`.
    """

    def below() -> Formula:
        return random_formula(
            generator,
            depth - 1,
            widest=widest,
            past=past,
            unbounded=unbounded,
            constants=constants,
            limits=limits,
            nexts=nexts,
        )

    if depth == 0 or generator.random() < 0.1:
        if constants and generator.random() < 0.1:
            return Constant(bool(generator.integers(2)))
        return Predicate(int(generator.integers(PREDICATES)))
    first = int(generator.integers(widest))
    last = None if unbounded and generator.random() < 0.25 else first + int(generator.integers(widest))
    if last is None and not limits:
        first = 0
    match int(generator.choice([0, 1, 2, 3, 4, 5, *[6] * nexts, *[7, 8, 9] * past])):
        case 0:
            return Not(below())
        case 1:
            return And(tuple(below() for _ in range(2 + int(generator.integers(2)))))
        case 2:
            return Or(tuple(below() for _ in range(2 + int(generator.integers(2)))))
        case 3:
            return Always(first, last, below())
        case 4:
            return Eventually(first, last, below())
        case 5:
            return Until(first, last, below(), below())
        case 6:
            return Next(below(), weak=bool(generator.integers(2)))
        case 7:
            return Historically(first, last, below())
        case 8:
            return Once(first, last, below())
        case _:
            return Since(first, last, below(), below())


def random_samples(generator: np.random.Generator, instants: int, rows: int) -> Array:
    """Robustness of each predicate [predicates, instants, rows]: small whole numbers, or any."""
    shape = (PREDICATES, instants, rows)
    if generator.random() < 0.5:
        drawn = generator.integers(-3, 4, shape).astype(float)
        return encoded(drawn, bool(generator.integers(2)))
    return generator.normal(size=shape)


def random_text(generator: np.random.Generator, depth: int, predicates: Sequence[str], *, windows: bool = True) -> str:
    """The text of a formula with a greatest depth of nested operators, in brackets throughout.

    Args:
        generator: Draws it.
        depth: The greatest depth.
        predicates: The texts of the predicates.
        windows: Whether operators have windows, of up to 0.5 s, and look back.
    """

    def below() -> str:
        return f"({random_text(generator, depth - 1, predicates, windows=windows)})"

    def window() -> str:
        if not windows or generator.random() < 0.4:
            return ""
        first = int(generator.integers(3))
        return f"[{first / 10}, {(first + int(generator.integers(3))) / 10}]"

    if depth == 0 or generator.random() < 0.1:
        return str(generator.choice(predicates))
    match str(generator.choice(WORDS if windows else WORDS[:-3])):
        case "not" | "next" | "weak next" as word:
            return f"{word} {below()}"
        case "and" | "or" | "implies" as word:
            return f"{below()} {word} {below()}"
        case "until" | "since" as word:
            return f"{below()} {word}{window()} {below()}"
        case word:
            return f"{word}{window()} {below()}"


#: All operators, those about the past at the end.
WORDS = (
    *("not", "and", "or", "implies", "next", "weak next", "until", "always", "eventually"),
    *("since", "historically", "once"),
)
