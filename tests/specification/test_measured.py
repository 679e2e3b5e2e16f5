"""The robustness on what was measured is that of the definitions, with windows cut to the instants that are known."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.random import default_rng

from symaware_cli.specification.formula import (
    Always,
    And,
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
)
from symaware_cli.specification.measured import measured


def recursion(formula: Formula, samples: list[list[float]]) -> list[float]:
    """The definitions of the operators, written down once more; at each instant."""
    count = len(samples[0])

    def ahead(t: int, first: int, last: int | None) -> range:
        return range(t + first, count if last is None else min(t + last + 1, count))

    def ago(t: int, first: int, last: int | None) -> range:
        return range(0 if last is None else max(t - last, 0), t - first + 1)

    @cache
    def at(of: Formula, t: int) -> float:
        match of:
            case Constant(value):
                return math.inf if value else -math.inf
            case Predicate(index):
                return samples[index][t]
            case Not(operand):
                return -at(operand, t)
            case And(operands):
                return min(at(each, t) for each in operands)
            case Or(operands):
                return max(at(each, t) for each in operands)
            case Always(first, last, operand):
                return min((at(operand, u) for u in ahead(t, first, last)), default=math.inf)
            case Eventually(first, last, operand):
                return max((at(operand, u) for u in ahead(t, first, last)), default=-math.inf)
            case Historically(first, last, operand):
                return min((at(operand, u) for u in ago(t, first, last)), default=math.inf)
            case Once(first, last, operand):
                return max((at(operand, u) for u in ago(t, first, last)), default=-math.inf)
            case Next(operand, weak):
                return at(operand, t + 1) if t + 1 < count else math.inf if weak else -math.inf
            case Until(first, last, left, right):
                values = (min([at(right, u), *(at(left, v) for v in range(t, u))]) for u in ahead(t, first, last))
                return max(values, default=-math.inf)
            case Since(first, last, left, right):
                values = (min([at(right, u), *(at(left, v) for v in range(u + 1, t + 1))]) for u in ago(t, first, last))
                return max(values, default=-math.inf)

    return [at(formula, t) for t in range(count)]


def random_formula(random: np.random.Generator, depth: int) -> Formula:
    if depth == 0 or random.random() < 0.2:
        return Predicate(int(random.integers(2))) if random.random() < 0.9 else Constant(bool(random.integers(2)))
    below = [random_formula(random, depth - 1) for _ in range(2)]
    first = int(random.integers(4))
    last = None if random.random() < 0.3 else first + int(random.integers(5))
    kind = random.integers(9)
    if kind < 3:
        return (Not(below[0]), And(tuple(below)), Or(tuple(below)))[kind]
    if kind < 7:
        return (Always, Eventually, Historically, Once)[kind - 3](first, last, below[0])
    return (Until, Since)[kind - 7](first, last, *below)


def test_it_is_that_of_the_definitions_for_random_formulas() -> None:
    random = default_rng(3)
    for _ in range(200):
        formula = random_formula(random, 3)
        count, rows = int(random.integers(1, 9)), 2
        samples = [random.normal(size=(count, rows)) for _ in range(2)]
        found = measured(formula, samples, count, rows)
        for row in range(rows):
            own = [each[:, row].tolist() for each in samples]
            assert found[:, row].tolist() == recursion(formula, own), formula


@pytest.mark.parametrize(
    ("formula", "robustness"), [(Eventually(0, 9, Predicate(0)), 2.0), (Always(0, 9, Predicate(0)), -1.0)]
)
def test_a_window_is_cut_to_what_is_known(formula: Formula, robustness: float) -> None:
    assert measured(formula, [np.array([[1.0], [2.0], [-1.0]])], 3, 1)[0, 0] == robustness
