"""Formulas and the syntax trees that they are made from have the same parts at the same places."""

import numpy as np
import pytest
from formulas import random_text

from symaware_cli.specification import formula as stl
from symaware_cli.specification.columns import ARGUMENTS
from symaware_cli.specification.formula import Formula, operands
from symaware_cli.specification.formulation import formulate, subformula
from symaware_cli.specification.node import Node
from symaware_cli.specification.parser import parse

NAMES = ("x", "y")
PREDICATES = ("x > 1", "y > 3", "x < 0.5", "abs(y) <= 2")
STEP = 100_000_000


def parsed(text: str) -> Node:
    return parse(text, NAMES, ARGUMENTS)


def named(formula: Formula, texts: tuple[str, ...]) -> str:
    """A formula with the texts of its predicates in place of their positions."""
    found = repr(formula)
    for index, text in enumerate(texts):
        found = found.replace(f"Predicate(index={index})", f"`{text}`")
    return found


@pytest.mark.parametrize("seed", range(60))
def test_the_part_at_each_place_means_what_the_formula_has_there(seed: int) -> None:
    generator = np.random.default_rng(seed)
    for _ in range(10):
        text = random_text(generator, 4, PREDICATES)
        whole = formulate(parsed(text), STEP)
        waiting: list[tuple[tuple[int, ...], Formula]] = [((), whole.formula)]
        for path, formula in waiting:
            part = formulate(subformula(whole.tree, path), STEP)
            expected = named(formula, tuple(atom.text for atom in whole.atoms))
            assert named(part.formula, tuple(atom.text for atom in part.atoms)) == expected, text
            waiting += [((*path, place), each) for place, each in enumerate(operands(formula))]


@pytest.mark.parametrize(
    ("text", "path", "part"),
    [
        ("(x > 1 or y > 3) implies x < 0.5", (0, 0, 1), "y > 3"),
        ("eventually[0, 0.2] x > 1 or (x < 0.5 and y > 3) implies abs(y) <= 2", (0, 0, 1, 1), "y > 3"),
        ("always (x > 1 implies weak next y > 3)", (0, 1, 0), "y > 3"),
    ],
)
def test_implications_have_their_place(text: str, path: tuple[int, ...], part: str) -> None:
    formulation = formulate(parsed(text), STEP)
    found = subformula(formulation.tree, path)
    assert formulation.atoms[_predicate(formulation.formula, path)].node == found == parsed(part)


def _predicate(formula: Formula, path: tuple[int, ...]) -> int:
    for place in path:
        formula = operands(formula)[place]
    assert isinstance(formula, stl.Predicate)
    return formula.index
