"""A game of an agent against its environment, in arrays: all states, and the moves of both.

At each step the agent chooses the cell to be in at the next step, and commits itself to it; then the environment
chooses the next values of its variables. So the agent never has to know the next move of the environment. In the terms
of reactive synthesis, its strategies are Moore machines.

Reasons: docs/decisions/0041-synthesis-on-arrays.md
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.fragment import Clause
from symaware_cli.knowledge.synthesis.vocabulary import CELL, Evaluate, Values, Vocabulary, says_next

Truth = NDArray[np.bool_]
Indices = NDArray[np.int32]

#: The greatest number of moves, over all states; each takes 4 bytes, and as many again while a game is solved.
_MOST_MOVES = 60_000_000


class GameSizeError(ValueError):
    """A game has too many states for this method."""


@dataclass(frozen=True)
class Statement:
    """An assumption about the environment, or a guarantee of the agent.

    Attributes:
        text: The formula.
        clauses: Its clauses.
    """

    text: str
    clauses: tuple[Clause, ...]


@dataclass(frozen=True)
class Bit:
    """A bit of memory: whether a response is pending, or whether something has happened once.

    Attributes:
        clause: The clause that it belongs to, of the kind ``response`` or ``once``.
        premise: Evaluates the condition of the clause.
        answer: Evaluates its answer; None for ``once``.
    """

    clause: Clause
    premise: Evaluate
    answer: Evaluate | None

    def updated(self, bit: Truth, values: Values) -> Truth:
        """Return the bit after values have become known, from the one before."""
        holds = np.asarray(self.premise(values, None))
        if self.answer is None:
            return np.asarray(bit | holds)
        return np.asarray((bit | holds) & ~np.asarray(self.answer(values, None)))


class Game:
    """The states and moves of a game; a state is an index.

    Attributes:
        vocabulary: The variables.
        assumptions: The assumptions about the environment.
        guarantees: The guarantees of the agent.
        bits: The bits of memory, of assumptions and then of guarantees.
        shape: The numbers of values: of each environment variable, of the cell, and of each bit.
    """

    def __init__(
        self, vocabulary: Vocabulary, assumptions: Sequence[Statement], guarantees: Sequence[Statement]
    ) -> None:
        """Prepare; arrays are computed when they are first used.

        Raises:
            GameSizeError: There are too many states and moves.
        """
        self.vocabulary = vocabulary
        self.assumptions = tuple(assumptions)
        self.guarantees = tuple(guarantees)
        self.bits = tuple(
            Bit(each, vocabulary.compiled(each.node), None if each.answer is None else vocabulary.compiled(each.answer))
            for each in (*_clauses(assumptions), *_clauses(guarantees))
            if each.kind in ("response", "once")
        )
        variables = (*vocabulary.environment, vocabulary.cell)
        self.shape = (*(each.size for each in variables), *(2 for _ in self.bits))
        size = 1
        for each in (*self.shape, *(max(map(len, each.following)) for each in variables)):
            size *= each
        if size > _MOST_MOVES:
            raise GameSizeError(
                f"the game has {np.prod(self.shape, dtype=float):,.0f} states and about {size:,} moves, more than "
                f"{_MOST_MOVES:,}: make cells larger, or name fewer propositions and agents under `labels`"
            )

    @cached_property
    def size(self) -> int:
        """The number of states."""
        return int(np.prod(self.shape))

    @cached_property
    def values(self) -> Mapping[str, NDArray[np.intp]]:
        """The value of each variable in each state; shape (size,) each."""
        names = [*(each.name for each in self.vocabulary.environment), CELL]
        every = np.unravel_index(np.arange(self.size), self.shape)
        return dict(zip(names, every, strict=False))

    @cached_property
    def bit_values(self) -> tuple[Truth, ...]:
        """Each bit in each state; shape (size,) each."""
        every = np.unravel_index(np.arange(self.size), self.shape)
        return tuple(each == 1 for each in every[len(self.vocabulary.environment) + 1 :])

    def index(self, values: Values, bits: Sequence[Truth]) -> Indices:
        """Return the states of values and bits; shape (n,)."""
        parts = [values[each.name] for each in self.vocabulary.environment]
        shaped = np.broadcast_arrays(*parts, values[CELL], *(each.astype(np.intp) for each in bits))
        return np.asarray(np.ravel_multi_index(shaped, self.shape), np.int32)

    def starting(self, values: Values) -> Indices:
        """Return the states at the beginning, with the bits that the first values set."""
        none = np.zeros(np.shape(values[CELL]), bool)
        return self.index(values, [bit.updated(none, values) for bit in self.bits])

    @cached_property
    def moves(self) -> Indices:
        """The states that may follow; shape (choices of the agent, answers of the environment, size).

        The number of states stands for an answer that the environment must not give, and that number plus one for a
        move after which the agent has broken a guarantee, or for a choice that it does not have.
        """
        cell = padded(self.vocabulary.cell.following)
        others = [padded(each.following) for each in self.vocabulary.environment]
        slots = list(itertools.product(*(range(each.shape[1]) for each in others)))
        moves = np.empty((cell.shape[1], len(slots), self.size), np.int32)
        for choice in range(cell.shape[1]):
            chosen = cell[self.values[CELL], choice]
            for place, slot in enumerate(slots):
                after, exists = {CELL: np.maximum(chosen, 0)}, np.ones(self.size, bool)
                for variable, table, option in zip(self.vocabulary.environment, others, slot, strict=True):
                    following = table[self.values[variable.name], option]
                    exists &= following >= 0
                    after[variable.name] = np.maximum(following, 0)
                exists &= self._keeps(self._assumed_safety, after)
                kept = self._keeps(self._guaranteed_safety, after)
                bits = [bit.updated(now, after) for bit, now in zip(self.bits, self.bit_values, strict=True)]
                moves[choice, place] = np.where(
                    exists, np.where(kept, self.index(after, bits), self.size + 1), self.size
                )
        exists = (cell[self.values[CELL]] >= 0).T
        answered = exists & (moves != self.size).any(axis=1)
        # An agent must not make it impossible to keep the assumptions; if that is so whatever it does, it has won.
        stuck = ~answered.any(axis=0)
        for choice in range(len(moves)):
            moves[choice][:, ~(answered[choice] | (exists[choice] & stuck))] = self.size + 1
        return moves

    def _keeps(self, safety: Sequence[tuple[Evaluate, bool]], after: Values) -> Truth:
        kept = np.ones(self.size, bool)
        for evaluate, ahead in safety:
            kept &= evaluate(self.values, after) if ahead else evaluate(after, None)
        return kept

    @cached_property
    def _assumed_safety(self) -> Sequence[tuple[Evaluate, bool]]:
        return self.safety(self.assumptions)

    @cached_property
    def _guaranteed_safety(self) -> Sequence[tuple[Evaluate, bool]]:
        return self.safety(self.guarantees)

    def safety(self, statements: Sequence[Statement]) -> Sequence[tuple[Evaluate, bool]]:
        """Return the safety of statements, and whether each says `next`; otherwise it is about the step after."""
        compiled = self.vocabulary.compiled
        return [(compiled(each.node), says_next(each.node)) for each in _clauses(statements) if each.kind == "safety"]

    def holds_at_start(self, statements: Sequence[Statement], values: Values) -> Truth:
        """Return whether the initial conditions of statements hold, and their safety without `next`; shape (n,)."""
        holds = np.ones(np.shape(values[CELL]), bool)
        for each in _clauses(statements):
            if each.kind == "initial" or (each.kind == "safety" and not says_next(each.node)):
                holds &= self.vocabulary.compiled(each.node)(values, None)
        return holds

    def goals(self, statements: Sequence[Statement]) -> tuple[Truth, ...]:
        """Return in which states each goal of statements is reached; shape (size,) each."""
        place = {id(bit.clause): number for number, bit in enumerate(self.bits)}
        found = []
        for each in _clauses(statements):
            if each.kind == "goal":
                compiled = self.vocabulary.compiled(each.node)
                found.append(np.broadcast_to(compiled(self.values, None), (self.size,)).copy())
            elif each.kind == "response":
                found.append(~self.bit_values[place[id(each)]])
            elif each.kind == "once":
                found.append(self.bit_values[place[id(each)]].copy())
        return tuple(found)

    def starts(self, cells: Sequence[int]) -> tuple[dict[str, NDArray[np.intp]], Truth]:
        """Return all values at the beginning for cells of the agent, and where the assumptions hold; shape (n,)."""
        sizes = [
            range(each.size) if each.system is None else each.system.initial for each in self.vocabulary.environment
        ]
        every = np.array(list(itertools.product(*sizes, cells)), np.intp).reshape(-1, len(sizes) + 1)
        names = [*(each.name for each in self.vocabulary.environment), CELL]
        values = {name: every[:, place] for place, name in enumerate(names)}
        return values, self.holds_at_start(self.assumptions, values)

    def described(self, values: Mapping[str, int]) -> str:
        """Describe one value of each variable, such as ``cell c0_1, open false``."""
        variables = (self.vocabulary.cell, *self.vocabulary.environment)
        return ", ".join(f"{each.name} {each.described(values[each.name])}" for each in variables)


def _clauses(statements: Sequence[Statement]) -> list[Clause]:
    return [clause for each in statements for clause in each.clauses]


def padded(following: Sequence[Sequence[int]]) -> NDArray[np.intp]:
    """Return lists of successors as an array, with -1 where there are no more; shape (n, longest)."""
    table = np.full((len(following), max(map(len, following))), -1, np.intp)
    for row, each in enumerate(following):
        table[row, : len(each)] = each
    return table
