"""Random formulas and signals."""

import numpy as np

from symaware_cli.specification.formula import (
    Always,
    And,
    Array,
    Constant,
    Eventually,
    Formula,
    Historically,
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
) -> Formula:
    """A formula of at most so many operators above each other.

    Args:
        generator: Draws it.
        depth: How many.
        widest: How far windows begin, and how many instants they have, at most.
        past: Whether operators look back, too.
        unbounded: Whether windows may have no end.
        constants: Whether there are constants.
        limits: Whether windows without an end may begin later.
    """

    def below() -> Formula:
        return random_formula(
            generator, depth - 1, widest=widest, past=past, unbounded=unbounded, constants=constants, limits=limits
        )

    if depth == 0 or generator.random() < 0.1:
        if constants and generator.random() < 0.1:
            return Constant(bool(generator.integers(2)))
        return Predicate(int(generator.integers(PREDICATES)))
    first = int(generator.integers(widest))
    last = None if unbounded and generator.random() < 0.25 else first + int(generator.integers(widest))
    if last is None and not limits:
        first = 0
    match int(generator.integers(9 if past else 6)):
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
            return Historically(first, last, below())
        case 7:
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
