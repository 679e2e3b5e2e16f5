"""Exact robustness agrees with that of other monitors, which read a whole signal at once."""

import platform
import sys
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from formulas import PREDICATES, random_formula, random_samples

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
    horizon,
    operands,
)
from symaware_cli.specification.monitor import Monitor

RTAMT = pytest.mark.skipif(sys.version_info >= (3, 13), reason="rtamt is not for this Python")
SENTIL = pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="sentil is not for this machine"
)


def text(formula: Formula, said: dict[str, str]) -> str:
    """A formula as others write it: variables p0, p1... and operators by their names."""

    def window(first: int, last: int | None) -> str:
        assert last is not None or first == 0
        return "" if last is None else f"[{first},{last}]"

    match formula:
        case Predicate(index):
            return f"(p{index} >= 0)"
        case Not(operand):
            return f"({said['not']}({text(operand, said)}))"
        case And(operands):
            return "(" + said["and"].join(text(each, said) for each in operands) + ")"
        case Or(operands):
            return "(" + said["or"].join(text(each, said) for each in operands) + ")"
        case Always(first, last, operand):
            return f"({said['always']}{window(first, last)}({text(operand, said)}))"
        case Eventually(first, last, operand):
            return f"({said['eventually']}{window(first, last)}({text(operand, said)}))"
        case Historically(first, last, operand):
            return f"({said['historically']}{window(first, last)}({text(operand, said)}))"
        case Once(first, last, operand):
            return f"({said['once']}{window(first, last)}({text(operand, said)}))"
        case Until(first, last, left, right):
            return f"(({text(left, said)}) {said['until']}{window(first, last)} ({text(right, said)}))"
        case Since(first, last, left, right):
            return f"(({text(left, said)}) {said['since']}{window(first, last)} ({text(right, said)}))"
        case Constant() | Next():
            raise NotImplementedError


def looks_ahead(formula: Formula) -> bool:
    """Whether a formula has windows ahead that end."""
    ahead = isinstance(formula, Always | Eventually | Until) and formula.last is not None
    return ahead or any(looks_ahead(each) for each in operands(formula))


def rtamt_robustness(formula: Formula, samples: Array) -> Array:
    """Robustness of one row at each instant."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import rtamt

        names = ("not", "always", "eventually", "historically", "once", "until", "since")
        specification = rtamt.StlDiscreteTimeOfflineSpecification()
        for i in range(PREDICATES):
            specification.declare_var(f"p{i}", "float")
        specification.spec = text(formula, {name: name for name in names} | {"and": " and ", "or": " or "})
        specification.parse()
        signals = {f"p{i}": samples[i].tolist() for i in range(PREDICATES)}
        found = specification.evaluate({"time": list(range(samples.shape[1])), **signals})
    return np.array([value for _, value in found])


def sentil_robustness(formula: Formula, samples: Array) -> Array:
    """Robustness of one row at each instant."""
    import sentil

    names = {"not": "!", "and": " && ", "or": " || ", "always": "G", "eventually": "F"}
    names |= {"historically": "H", "once": "O", "until": "U", "since": "S"}
    trace = sentil.Trace.indexed(samples.shape[1])
    trace.add_signals({f"p{i}": samples[i] for i in range(PREDICATES)})
    return sentil.parse(text(formula, names)).robustness_signal(trace)


@pytest.mark.parametrize(
    "robustness", [pytest.param(rtamt_robustness, marks=RTAMT), pytest.param(sentil_robustness, marks=SENTIL)]
)
@pytest.mark.parametrize("seed", range(5))
def test_exact_robustness_is_that_of_others(robustness: Callable[[Formula, Array], Array], seed: int) -> None:
    generator = np.random.default_rng(seed)
    compared = 0
    for case in range(80):
        formula = random_formula(generator, int(generator.integers(1, 5)), constants=False, limits=False, nexts=False)
        if horizon(formula) is None and looks_ahead(formula):
            # Others cut windows where the run ends; here they are undecided.
            continue
        samples = random_samples(generator, int(generator.integers(4, 25)), 2)
        monitor = Monitor(formula, 2, interval=False)
        for t in range(samples.shape[1]):
            monitor.update(list(samples[:, t]))
        monitor.finish()
        _, exact = monitor.exact()
        for row in range(2):
            expected = robustness(formula, samples[:, :, row])[: len(exact)]
            known = ~np.isnan(exact[:, row])
            compared += int(known.sum())
            np.testing.assert_array_equal(
                np.clip(exact[known, row], -1e300, 1e300),
                np.clip(expected[known], -1e300, 1e300),
                err_msg=f"case {case}: {formula}\n{samples[:, :, row].tolist()}",
            )
    assert compared > 300
