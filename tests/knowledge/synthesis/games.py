"""Random small games, and a second way of solving games: sets of plain values, straight from the definitions."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np

from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.knowledge.synthesis.fragment import Clause, clauses
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.vocabulary import CELL, Variable, Vocabulary
from symaware_cli.specification.node import Comparison, Constant, Element, Junction, Name, Node, Not, Temporal, walk

#: The values of all variables, and the bits of memory.
State = tuple[tuple[int, ...], tuple[bool, ...]]


def game(
    system: TransitionSystem,
    environment: Sequence[Variable],
    assumptions: Iterable[str],
    guarantees: Iterable[str],
) -> Game:
    vocabulary = Vocabulary(system, environment)
    stated = [[Statement(text, clauses(text, vocabulary)) for text in every] for every in (assumptions, guarantees)]
    return Game(vocabulary, *stated)


def random_system(draw: np.random.Generator, most: int = 4) -> TransitionSystem:
    count = int(draw.integers(2, most + 1))
    names = [f"s{place}" for place in range(count)]
    after = {
        name: [names[each] for each in draw.permutation(count)[: int(draw.integers(1, min(count, 3) + 1))]]
        for name in names
    }
    labels = {label: [name for name in names if draw.random() < 0.4] for label in ("p", "q")}
    return TransitionSystem.of(after, [name for name in names if draw.random() < 0.7] or names, labels)


def random_game(draw: np.random.Generator) -> Game:
    system = random_system(draw)
    environment = [Variable("e")]
    if draw.random() < 0.4:
        environment.append(Variable("f"))
    if draw.random() < 0.5:
        environment.append(Variable("other", system if draw.random() < 0.5 else random_system(draw, 3)))
    literals = ["p", "q", *(each.name for each in environment if each.system is None)]
    literals += [f'cell == "{system.states[0]}"']
    for each in environment:
        if each.system is not None:
            literals += ["other.p", f'other != "{each.system.states[0]}"']
            literals += ["other == cell"] if each.system is system else []
    moves = [*literals, *(f"next ({each})" for each in literals)]

    def condition(atoms: Sequence[str], depth: int = 2) -> str:
        if depth == 0 or draw.random() < 0.3:
            atom = str(draw.choice(atoms))
            return f"(not ({atom}))" if draw.random() < 0.3 else f"({atom})"
        operator = draw.choice(["and", "or", "implies"])
        return f"({condition(atoms, depth - 1)} {operator} {condition(atoms, depth - 1)})"

    def formula(initial: bool) -> str:
        kind = draw.choice(["safety", "safety", "goal", "goal", "response", "once", "initial"])
        match kind:
            case "safety":
                return f"always {condition(moves)}"
            case "goal":
                return f"always eventually {condition(literals)}"
            case "response":
                return f"always ({condition(literals, 1)} implies eventually {condition(literals, 1)})"
            case "once":
                return f"eventually {condition(literals)}"
        return condition(literals) if initial else f"always eventually {condition(literals)}"

    assumptions = [formula(True) for _ in range(draw.integers(0, 3))]
    return game(system, environment, assumptions, [formula(False) for _ in range(draw.integers(1, 4))])


class PlainGame:
    """A game in plain values, solved by fixpoints of sets."""

    def __init__(self, of: Game) -> None:
        self.of = of
        self.variables = (*of.vocabulary.environment, of.vocabulary.cell)
        self.names = [each.name for each in self.variables]
        self.labels = {each.name: each.system.labels if each.system else {} for each in self.variables}
        self.states_of = {each.name: each.system.states if each.system else () for each in self.variables}
        self.assumed = [clause for each in of.assumptions for clause in each.clauses]
        self.guaranteed = [clause for each in of.guarantees for clause in each.clauses]
        self.remembered = [each for each in (*self.assumed, *self.guaranteed) if each.kind in ("response", "once")]
        values = itertools.product(*(range(each.size) for each in self.variables))
        bits = list(itertools.product((False, True), repeat=len(self.remembered)))
        self.states: list[State] = [(each, other) for each in values for other in bits]
        self.moves = {state: self._moves(state) for state in self.states}

    def truth(self, node: Node, now: Mapping[str, int], after: Mapping[str, int] | None = None) -> bool:
        match node:
            case Constant(value=bool() as value):
                return value
            case Not(operand=operand):
                return not self.truth(operand, now, after)
            case Junction(operator="and", operands=operands):
                return all(self.truth(each, now, after) for each in operands)
            case Junction(operator="or", operands=operands):
                return any(self.truth(each, now, after) for each in operands)
            case Junction(operands=(premise, conclusion)):
                return not self.truth(premise, now, after) or self.truth(conclusion, now, after)
            case Temporal(operands=(operand,)):
                assert after is not None
                return self.truth(operand, after)
            case Comparison(operators=(operator,), operands=(one, other)):
                return (self.cell(one, now, after) == self.cell(other, now, after)) == (operator == "==")
            case Name(name=name) if name in now:
                return bool(now[name])
            case Name(name=name):
                return now[CELL] in self.labels[CELL][name]
            case Element(operand=Name(name=name), key=str() as key):
                return now[name] in self.labels[name][key]
        raise AssertionError(node)

    def cell(self, node: Node, now: Mapping[str, int], after: Mapping[str, int] | None) -> str:
        if isinstance(node, Temporal):
            assert after is not None
            return self.cell(node.operands[0], after, None)
        if isinstance(node, Name):
            return self.states_of[node.name][now[node.name]]
        assert isinstance(node, Constant)
        assert isinstance(node.value, str)
        return node.value

    def keeps(self, every: Sequence[Clause], now: Mapping[str, int], after: Mapping[str, int]) -> bool:
        return all(
            self.truth(each.node, now, after)
            if any(isinstance(node, Temporal) for node in walk(each.node))
            else self.truth(each.node, after)
            for each in every
            if each.kind == "safety"
        )

    def bits(self, before: Sequence[bool], values: Mapping[str, int]) -> tuple[bool, ...]:
        found = []
        for each, bit in zip(self.remembered, before, strict=True):
            holds = bit or self.truth(each.node, values)
            found.append(holds and not (each.answer is not None and self.truth(each.answer, values)))
        return tuple(found)

    def _moves(self, state: State) -> list[list[State | None]]:
        """The states that may follow, for each choice of the agent; None if that breaks a guarantee."""
        values, bits = state
        now = dict(zip(self.names, values, strict=True))
        choices = []
        own = self.variables[-1].following[now[CELL]]
        for cell in own:
            answers: list[State | None] = []
            for others in itertools.product(
                *(each.following[now[each.name]] for each in self.of.vocabulary.environment)
            ):
                after = dict(zip(self.names, (*others, cell), strict=True))
                if self.keeps(self.assumed, now, after):
                    kept = self.keeps(self.guaranteed, now, after)
                    answers.append(((*others, cell), self.bits(bits, after)) if kept else None)
            choices.append(answers)
        return [
            each for each in choices if each
        ] or choices  # a choice that leaves no answer is none, if there are others

    def goals(self, every: Sequence[Clause]) -> list[Callable[[State], bool]]:
        found: list[Callable[[State], bool]] = []
        for each in every:
            place = next((number for number, one in enumerate(self.remembered) if one is each), -1)
            if each.kind == "goal":
                found.append(partial(self._meets, each.node))
            elif each.kind in ("response", "once"):
                found.append(partial(self._remembers, place, each.kind == "once"))
        return found or [lambda state: True]

    def _meets(self, node: Node, state: State) -> bool:
        return self.truth(node, dict(zip(self.names, state[0], strict=True)))

    def _remembers(self, place: int, wanted: bool, state: State) -> bool:
        return state[1][place] == wanted

    def forced(self, state: State, target: set[State]) -> bool:
        return any(all(each in target for each in answers) for answers in self.moves[state])

    def winning(self) -> set[State]:
        """The three nested fixpoints, each from its extreme."""
        own, others = self.goals(self.guaranteed), self.goals(self.assumed)
        outer = set(self.states)
        while True:
            smaller = set(self.states)
            for goal in own:
                middle: set[State] = set()
                while True:
                    larger: set[State] = set()
                    for other in others:
                        inner = set(self.states)
                        while True:
                            fewer = {
                                state
                                for state in self.states
                                if (goal(state) and self.forced(state, outer))
                                or self.forced(state, middle)
                                or (not other(state) and self.forced(state, inner))
                            }
                            if fewer == inner:
                                break
                            inner = fewer
                        larger |= inner
                    if larger == middle:
                        break
                    middle = larger
                smaller &= middle
            if smaller == outer:
                return outer
            outer = smaller
