"""An expression has one value, wherever it stands, and each operator and function has one definition."""

import ast
import random
from collections.abc import Mapping
from inspect import ismodule
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pytest
from expressions import REGIONS, ROWS, RandomExpression, drawn, pose

import symaware_cli
from symaware_cli import specification
from symaware_cli.evidence.row_evaluator import RegionHere, row_robustness, row_value
from symaware_cli.planning.optimal_control.affine_predicate import Affine, predicate_sets
from symaware_cli.planning.risk.predicate_bounds import NotLinearError, predicate_bound
from symaware_cli.specification.closest_pair import check_least
from symaware_cli.specification.columns import ARGUMENTS, ARITHMETIC, COMPARISONS, FUNCTIONS, truth, values
from symaware_cli.specification.expression import EvaluationError, Expression
from symaware_cli.specification.formulation import formulate
from symaware_cli.specification.measured import measured
from symaware_cli.specification.node import Node
from symaware_cli.specification.parser import LEVEL, PRECEDENCE, parse
from symaware_cli.specification.region import PlacedRegion
from symaware_cli.specification.token import ExpressionError
from symaware_cli.studies.sweep_query import query

PLACED = {name: PlacedRegion(name, REGIONS, pose) for name in REGIONS}
HERE = {name: RegionHere(name, REGIONS, pose) for name in REGIONS}
PACKAGE = Path(symaware_cli.__file__).parent


def of_row(rows: Mapping[str, Any], row: int) -> Mapping[str, Any]:
    """The values of one row, as those who look them up one by one have them: numbers, vectors, lists."""
    own = {name: each[row] if isinstance(each, np.ndarray) else each for name, each in rows.items()}
    return {**own, "goal": own["goal"].tolist(), **PLACED}


def at_an_instant(tree: Node, look_up: Any) -> tuple[np.ndarray, np.ndarray]:
    """The robustness of a specification at one instant, and which rows have a value."""
    formulation = formulate(tree, 10**9)
    with np.errstate(all="ignore"):
        samples = [np.broadcast_to(atom.robustness(look_up), (1, ROWS)) for atom in formulation.atoms]
    found = measured(formulation.formula, samples, 1, ROWS)[0]
    return found, ~np.isnan(np.array(samples)).any(axis=(0, 1))


@pytest.mark.parametrize("seed", range(10))
def test_a_condition_holds_where_a_specification_and_a_condition_on_rows_do(seed: int) -> None:
    draw = random.Random(seed)
    formula, compared = RandomExpression(draw), 0
    for _ in range(60):
        rows, text = drawn(draw), formula.condition(draw.randint(0, 2))
        if len(text) > 500:
            continue
        look_up = {**rows, **PLACED}.__getitem__
        condition = Expression(text, {*rows, *PLACED})
        robust, has_value = at_an_instant(condition.tree, look_up)
        with np.errstate(all="ignore"):
            whole = np.broadcast_to(truth(condition.tree)(look_up), ROWS)
        for row in np.flatnonzero(has_value).tolist():
            try:
                holds = condition.holds(of_row(rows, row).__getitem__)
            except EvaluationError:  # a division by zero, which a specification may pass by, as in count(...)
                continue
            assert (holds, whole[row]) == (robust[row] > 0.0,) * 2, f"{text} with {of_row(rows, row)}"
            compared += 1
    assert compared > 150


@pytest.mark.parametrize("seed", range(10))
def test_a_value_is_the_same_to_the_bit_for_a_metric_in_columns_and_for_the_independent_witness(seed: int) -> None:
    draw = random.Random(seed)
    formula, compared = RandomExpression(draw), 0
    for _ in range(60):
        depth = draw.randint(0, 3)
        rows, text = drawn(draw), draw.choice((formula.number(depth), formula.vector(depth)))
        if len(text) > 500:
            continue
        expression = Expression(text, {*rows, *PLACED})
        with np.errstate(all="ignore"):
            whole = np.asarray(values(expression.tree)({**rows, **PLACED}.__getitem__), float)
            for row in range(ROWS):
                expected = whole if whole.ndim == 0 else whole[row % len(whole)]
                own = of_row(rows, row)
                seen = np.asarray(row_value(expression.tree, {**own, **HERE}.__getitem__), float)
                assert np.array_equal(seen, expected, equal_nan=True), f"{text} with {own}"
                try:
                    found = np.asarray(expression.value(own.__getitem__), float)
                except EvaluationError:  # a division by zero, of which a metric has no value
                    assert "/" in text or "%" in text
                else:
                    assert np.array_equal(found, expected, equal_nan=True), f"{text} with {own}"
                    compared += 1
    assert compared > 200


SCALARS = ("speed", "x", "ready", "name")


@pytest.mark.parametrize("seed", range(10))
def test_where_of_a_table_has_the_rows_of_which_a_condition_holds(seed: int) -> None:
    draw = random.Random(seed)

    def number(depth: int) -> str:
        if depth == 0:
            return draw.choice(("speed", "x", "1.5", "0", "2", "ready"))
        one, other = number(depth - 1), number(depth - 1)
        texts = [f"({one} {sign} {other})" for sign in "+-*"] + [f"{name}({one}, {other})" for name in ("max", "min")]
        return draw.choice([*texts, f"abs({one})", f"norm([{one}, {other}])", f"sqrt(abs({one}))", f"wrap({one})"])

    def condition(depth: int) -> str:
        if depth == 0:
            compared = f"{number(draw.randint(0, 2))} {draw.choice(tuple(COMPARISONS))} {number(1)}"
            return draw.choice((compared, compared, "ready", 'name == "a"', '"b" != name'))
        one, other = condition(depth - 1), condition(depth - 1)
        return draw.choice([f"not {one}", *(f"({one} {word} {other})" for word in ("and", "or", "implies"))])

    for _ in range(40):
        rows, text = drawn(draw), condition(draw.randint(0, 2))
        table = pyarrow.table({"index": range(ROWS), **{name: rows[name].tolist() for name in SCALARS}})
        chosen = query(table, text)["index"].to_pylist()
        each = Expression(text, SCALARS)
        assert chosen == [row for row in range(ROWS) if each.holds(of_row(rows, row).__getitem__)], text


@pytest.mark.parametrize("sign", COMPARISONS)
def test_nan_compares_with_nothing_and_infinity_with_itself(sign: str) -> None:
    tree = parse(f"x {sign} y", {"x", "y"}, ARGUMENTS)
    for x, y in ((np.nan, 1.0), (np.nan, np.nan), (np.inf, np.inf), (-np.inf, np.inf), (0.0, -0.0)):
        holds = (sign != "!=" and eval(f"{x} {sign} {y}", {"nan": np.nan, "inf": np.inf})) or (sign == "!=" and x != y)
        expected = bool(holds) and not (np.isnan(x) or np.isnan(y))
        assert Expression(f"x {sign} y", {"x", "y"}).holds({"x": x, "y": y}.__getitem__) is expected
        with np.errstate(all="ignore"):
            for given in (x, np.array([x, x])):
                found = truth(tree)({"x": given, "y": np.array([y, y])}.__getitem__)
                assert np.broadcast_to(found, 2).tolist() == [expected] * 2
                margin = row_robustness(tree, {"x": x, "y": y}.__getitem__)
                assert (margin > 0.0) is expected or bool(margin > 0.0) is expected


def test_a_guard_keeps_what_has_no_value_from_being_evaluated() -> None:
    names = {"x": 0.0, "knowledge": {}}
    for text in ("x != 0 and 1 / x > 1", "x == 0 or 1 / x > 1", 'x > 0 implies knowledge["plan"] > 1'):
        assert Expression(text, names).holds(names.__getitem__) is not text.startswith("x != 0")
    with pytest.raises(EvaluationError, match="division by zero"):
        Expression("1 / x > 1 and x != 0", names).holds(names.__getitem__)


# One table each

#: Where a dictionary has several functions or operators of expressions as its keys, and why.
TABLES = {
    "specification/columns.py": "the definitions",
    "evidence/row_evaluator.py": "the independent witness",
    "studies/custom_metrics.py": "reductions of a series over time",
    "planning/risk/pair_conditions.py": "comparisons with their sides exchanged",
    "knowledge/abstraction/dot.py": "brackets of another language",
    "views/plotting/pgf_file.py": "characters of another language",
}


def test_operators_and_functions_are_defined_in_one_table() -> None:
    words = {*FUNCTIONS, *ARITHMETIC, *COMPARISONS}
    found: dict[str, list[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Dict) and any(isinstance(each, ast.Constant) for each in node.keys):
                keys = {str(each.value) for each in node.keys if isinstance(each, ast.Constant)} & words
                if len(keys) > 1:
                    found.setdefault(path.relative_to(PACKAGE).as_posix(), []).extend(sorted(keys))
    assert found.keys() == TABLES.keys()
    assert sorted(found["specification/columns.py"]) == sorted(words)


def test_every_operator_of_the_grammar_has_a_definition() -> None:
    levels = {operator: LEVEL[operator] for operator in (*ARITHMETIC, *COMPARISONS)}
    assert set(levels) == {each for row in PRECEDENCE[LEVEL["<"] :] for each in row} - {"sign"}


def test_the_witness_shares_nothing_but_the_tree() -> None:
    allowed = {"absence", "formula", "node"}
    for name in ("link_here", "row_evaluator", "semantics"):
        tree = ast.parse((PACKAGE / "evidence" / f"{name}.py").read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("symaware_cli.specification"):
                parts = (node.module or "").split(".")[2:3]
                named = [] if parts else [(each.name, getattr(specification, each.name)) for each in node.names]
                homes = [name if ismodule(thing) else thing.__module__.split(".")[2] for name, thing in named]
                assert {*parts, *homes} <= allowed
                assert not {"encoded", "plain"} & {each.name for each in node.names}
            if isinstance(node, ast.ImportFrom) and node.module == "symaware_cli.geometry":
                described = {"Articulation", "Region", "RegionShape"}
                assert {each.name for each in node.names} <= described, "shapes and links, but nothing that computes"


# Other interpretations


def forms() -> dict[str, str]:
    """An expression with each operator and function, which depends on the state."""
    arguments = {1: "position", 2: "position, near", None: "position[0], position[1]"}
    sides = {"inside": "position, near", "signed_distance": "position, near", "distance": "position, [1, 2]"}
    calls = {
        name: f"{name}({sides.get(name, 'position[0], 2' if count == 2 else arguments[count])})"
        for name, count in ARGUMENTS.items()
    }
    found = {name: f"{call} > 0" for name, call in calls.items()}
    found |= {name: f"{name}(position > 1)" for name in ("all", "any")} | {"inside": calls["inside"]}
    found |= {sign: f"position[0] {sign} 2 > 0" for sign in ARITHMETIC}
    return found | {sign: f"position[0] {sign} 2" for sign in COMPARISONS}


LINEAR = {"+", "-", "*", "/", "<", "<=", ">", ">=", "inside"}


def accepts(interpretation: str, text: str) -> bool:
    tree = parse(text, {"position", "near"}, ARGUMENTS)
    try:
        match interpretation:
            case "bounds of probabilities":
                predicate_bound(tree, {"position"}, REGIONS)
            case "linear programs":
                predicate_sets(formulate(tree, 10**9), {"position": Affine(np.eye(2))}, REGIONS)
            case "the closest pair":
                pair = text.replace("position[0]", "distance").replace("position[1]", "distance")
                check_least(parse(pair.replace("position", "distance"), {"distance", "near"}, ARGUMENTS))
    except (NotLinearError, ExpressionError):
        return False
    return True


@pytest.mark.parametrize(
    ("interpretation", "known"),
    [
        ("bounds of probabilities", LINEAR),
        ("linear programs", LINEAR | {"all", "any", "distance", "norm"}),
        ("the closest pair", {"+", "-", "*", "/", ">", ">=", "max", "min", "sqrt"}),
    ],
)
def test_an_operator_that_an_interpretation_does_not_know_is_refused(interpretation: str, known: set[str]) -> None:
    found = forms()
    assert found.keys() == {*FUNCTIONS, *ARITHMETIC, *COMPARISONS}
    assert {name for name, text in found.items() if accepts(interpretation, text)} == known


def test_pairs_of_precedence_are_in_order() -> None:
    rows = [LEVEL[row[0]] for row in PRECEDENCE]
    assert all(one < other for one, other in pairwise(rows))
