"""Automata of linear temporal logic: verdicts of four values, equal to the definitions over finite runs."""

import itertools
import random

import numpy as np
import pytest

from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.specification import formula as stl
from symaware_cli.specification.automaton import Automaton, AutomatonError, AutomatonMonitor
from symaware_cli.specification.formula import (
    Always,
    And,
    Constant,
    Eventually,
    Formula,
    Next,
    Not,
    Once,
    Or,
    Predicate,
    Until,
)
from symaware_cli.specification.monitor import Monitor

A, B = Predicate(0), Predicate(1)


def holds(formula: Formula, run: list[int], at: int) -> bool:
    """Whether a formula holds at an instant of a finite run of letters; straight from the definitions."""
    match formula:
        case Constant(value=value):
            return value
        case Predicate(index=index):
            return bool(run[at] >> index & 1)
        case Not(operand=operand):
            return not holds(operand, run, at)
        case And(operands=operands):
            return all(holds(each, run, at) for each in operands)
        case Or(operands=operands):
            return any(holds(each, run, at) for each in operands)
        case Next(operand=operand, weak=weak):
            return holds(operand, run, at + 1) if at + 1 < len(run) else weak
        case Always(operand=operand):
            return all(holds(operand, run, later) for later in range(at, len(run)))
        case Eventually(operand=operand):
            return any(holds(operand, run, later) for later in range(at, len(run)))
        case Until(left=left, right=right):
            return any(
                holds(right, run, later) and all(holds(left, run, before) for before in range(at, later))
                for later in range(at, len(run))
            )
    raise TypeError(formula)


def formula_of(chance: random.Random, depth: int) -> Formula:
    if depth == 0 or chance.random() < 0.15:
        leaves: list[Formula] = [A, B, Constant(True), Constant(False), A, B]
        return chance.choice(leaves)
    inner, other = formula_of(chance, depth - 1), formula_of(chance, depth - 1)
    made: list[Formula] = [
        Not(inner),
        And((inner, other)),
        Or((inner, other)),
        Always(0, None, inner),
        Eventually(0, None, inner),
        Next(inner),
        Next(inner, weak=True),
        Until(0, None, inner, other),
    ]
    return chance.choice(made)


@pytest.mark.parametrize("seed", range(300))
def test_a_state_accepts_if_the_formula_holds_of_the_run(seed: int) -> None:
    chance = random.Random(seed)
    formula = formula_of(chance, 4)
    automaton = Automaton(formula, 2)
    runs = [[chance.randrange(4) for _ in range(length)] for length in (1, 2, 3, 4, 7) for _ in range(5)]
    for run in runs:
        monitor = AutomatonMonitor(automaton, 1)
        for letter in run:
            monitor.update([np.array([1.0 if letter >> index & 1 else -1.0]) for index in range(2)])
        assert bool(monitor.presumption[0] > 0) == holds(formula, run, 0)
        monitor.finish()
        assert monitor.verdict[0] == (1 if holds(formula, run, 0) else -1)


@pytest.mark.parametrize("seed", range(100))
def test_both_logics_give_the_same_verdict_at_the_end_of_a_run(seed: int) -> None:
    chance = random.Random(seed)
    formula = formula_of(chance, 4)
    for length in (1, 2, 5):
        run = [chance.randrange(4) for _ in range(length)]
        samples = [np.array([[1.0 if letter >> index & 1 else -1.0] for letter in run]) for index in range(2)]
        monitor = Monitor(formula, 1)
        for t in range(length):
            monitor.update([each[t] for each in samples])
        monitor.finish()
        (low,), (high,) = robustness_interval(formula, samples, length, 1, ended=True, times=1)
        assert (low[0] > 0.0, high[0] < 0.0) == (monitor.verdict[0] > 0, monitor.verdict[0] < 0)
        assert monitor.verdict[0] == (1 if holds(formula, run, 0) else -1)


@pytest.mark.parametrize("seed", range(100))
def test_a_verdict_is_decided_exactly_when_no_way_to_go_on_changes_it(seed: int) -> None:
    chance = random.Random(1000 + seed)
    formula = formula_of(chance, 3)
    automaton = Automaton(formula, 2)
    run = [chance.randrange(4) for _ in range(chance.randrange(1, 4))]
    state = 0
    for letter in run:
        state = int(automaton.transitions[state, letter])
    # With as many further letters as there are states, all that can be reached is reached; three are enough here.
    futures = [list(each) for length in range(4) for each in itertools.product(range(4), repeat=length)]
    found = {holds(formula, run + future, 0) for future in futures}
    if automaton.verdicts[state]:
        assert found == {automaton.verdicts[state] > 0}
    elif len(automaton.accepting) <= 4:
        assert found == {True, False}


@pytest.mark.parametrize(
    ("formula", "verdict"),
    [
        (Or((A, Not(A))), 1),
        (Or((Eventually(0, None, A), Always(0, None, Not(A)))), 1),
        (And((Always(0, None, A), Eventually(0, None, Not(A)))), -1),
        (Always(0, None, Eventually(0, None, A)), 0),
    ],
)
def test_tautologies_are_decided_at_once(formula: Formula, verdict: int) -> None:
    automaton = Automaton(formula, 1)
    assert set(automaton.verdicts[automaton.transitions[0]].tolist()) == {verdict}


def test_rows_are_followed_apart_and_some_can_be_selected() -> None:
    monitor = AutomatonMonitor(Automaton(Until(0, None, A, B), 2), 3)
    monitor.update([np.array([1.0, -1.0, 1.0]), np.array([-1.0, -1.0, 1.0])])
    assert monitor.verdict.tolist() == [0, -1, 1]
    assert monitor.select(np.array([2, 0])).verdict.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("formula", "propositions", "said"),
    [
        (Always(0, 5, A), 1, "no windows"),
        (Once(0, None, A), 1, "no operators about the past"),
        (A, 11, "11 propositions, and 10 at most"),
    ],
)
def test_formulas_without_an_automaton_are_refused(formula: Formula, propositions: int, said: str) -> None:
    with pytest.raises(AutomatonError, match=said):
        Automaton(formula, propositions)


def test_an_automaton_that_grows_too_large_is_refused() -> None:
    delayed: stl.Formula = A
    for _ in range(14):
        delayed = Next(delayed)
    with pytest.raises(AutomatonError, match="more than 2,000 states; split the formula"):
        Automaton(Eventually(0, None, And((B, delayed))), 2)
