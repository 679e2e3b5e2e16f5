"""Repeatable random draws, each keyed by its purpose.

A draw depends on the seed of the run, the drawing agent and purpose, the turn, and the other agent that it concerns. It
depends neither on earlier draws nor on other agents, so two variants of a scenario have the same draws for the agents
that they share.

There is no state: a counter-based generator scrambles a key, which BLAKE2b derives from seed, purpose and turn, and a
counter, which identifies the drawing agent and the other one. So a thousand agents draw in one array operation, and no
generators are created at the start. BLAKE2b is used because Python's own hash differs between processes.
Philox-4x32-10: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3",
SC 2011.

Reasons: docs/decisions/0018-chance-by-purpose.md
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from hashlib import blake2b
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import compiled

Array = NDArray[np.float64]
Numbers = NDArray[np.uint64]
Words = NDArray[np.uint32]
Indices = NDArray[np.intp]
Draw = Callable[[Numbers, Numbers, int | Numbers, int], Array]

#: The seed of a run, or of several runs whose agents share columns: those of the first run, then those of the second...
Seed = int | Sequence[int]

_ROUNDS = 10
_MULTIPLIERS = np.array([[0xD2511F53], [0xCD9E8D57]], np.uint64)
_WEYL = np.array([[0x9E3779B9], [0xBB67AE85]], np.uint32)
_LOW, _HIGH = (0, 1) if sys.byteorder == "little" else (1, 0)

#: How many counters are scrambled at a time: small enough for intermediate results to stay in the processor's cache.
_BLOCK = 4096

#: Numbers drawn ahead for future turns, at most; the most turns, and the fewest for which it is worthwhile.
_AHEAD, _MOST_TURNS, _FEWEST_TURNS = 4096, 32, 2

#: 2**-32, 2**-53, and 2 pi / 2**32.
_OF_32, _OF_53, _ANGLE = 2.0**-32, 2.0**-53, 2.0 * math.pi * 2.0**-32


class Turn(NamedTuple):
    """A turn of a component.

    Attributes:
        instant: Its beginning, in nanoseconds.
        repetition: The number of earlier turns at the same instant; -1 for the initialisation.
    """

    instant: int
    repetition: int = 0


class DrawCount:
    """Counts the draws within a context; those of other threads are counted as well.

    Attributes:
        count: The number of calls that drew numbers.
    """

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        _counts.append(self)
        return self

    def __exit__(self, *error: object) -> None:
        _counts.remove(self)


_counts: list[DrawCount] = []


def _note_draw() -> None:
    for each in _counts:
        each.count += 1


def philox(first: Numbers, second: Numbers, key: int | Numbers) -> tuple[Words, Words]:
    """Scramble counters with keys.

    Args:
        first: The first half of each counter; shape (m,).
        second: The second half; shape (m,).
        key: One key for all, or one for each, shape (m,).

    Returns:
        Words 0 and 2, and words 1 and 3, of each counter; each of shape (2, m).
    """
    if _counts:
        _note_draw()
    return _scrambled(first, second, key)


def _scrambled(first: Numbers, second: Numbers, key: int | Numbers) -> tuple[Words, Words]:
    """Scramble as `philox`, uncounted."""
    count = len(first)
    keys = np.array(_words(np.array([key], np.uint64) if isinstance(key, int) else key), order="C")
    even, odd = np.zeros((2, count), np.uint64), np.empty((2, count), np.uint32)
    # The products of a round and of the previous one; each is a low and a high word, which go to the other lane.
    products = np.empty((2, 2, count), np.uint64)
    factor = even.view(np.uint32)[:, _LOW::2]
    crossed = products[:, ::-1].view(np.uint32)
    low, high = crossed[..., _LOW::2], crossed[..., _HIGH::2]
    for half, lane in enumerate((first, second)):
        factor[half], odd[half] = _words(lane)
    rest: Words = odd
    for number in range(_ROUNDS):
        product = products[number % 2]
        np.multiply(even, _MULTIPLIERS, out=product)
        np.bitwise_xor(rest, keys, out=odd)
        np.bitwise_xor(high[number % 2], odd, out=factor)
        rest = low[number % 2]
        keys += _WEYL
    return factor, rest


def _words(numbers: Numbers) -> Words:
    """Return the low and the high words of numbers of 64 bits; shape (2, m)."""
    words: Words = np.ascontiguousarray(numbers).view(np.uint32).reshape(-1, 2).T[:: 1 if _LOW == 0 else -1]
    return words


def number_of(text: str) -> int:
    """Return a 64-bit number that depends on a text only, not on process, platform or order."""
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest(), "little")


def agent_numbers(ids: Iterable[str]) -> Numbers:
    """Return the numbers of agents in counters, which depend on their ids only; shape (n,)."""
    return np.array([number_of(id) for id in ids], np.uint64)


def key_of(seed: int, *purpose: str | int) -> int:
    """Return a 64-bit key for one purpose, such as the name of a component, a kind of draws and a turn."""
    return number_of("\0".join(map(str, (seed, *purpose))))


def fraction(seed: int, *purpose: str | int) -> float:
    """Draw a single number from the open interval (0, 1), from the key itself."""
    if _counts:
        _note_draw()
    return ((key_of(seed, *purpose) >> 12) + 0.5) * 2.0**-52


def combined(first: Numbers, second: Numbers, key: int) -> Numbers:
    """Combine pairs to 64-bit numbers, such as the ends of a link to its key; shape (m,)."""
    even, odd = philox(first, second, key)
    numbers: Numbers = odd[0].astype(np.uint64) << np.uint64(32) | even[0]
    return numbers


def message_fractions(keys: Numbers, numbers: NDArray[np.int64], page: int) -> Array:
    """Draw four numbers from the open interval (0, 1) for each message, in steps of 2**-32.

    Args:
        keys: The keys of the links; shape (m,).
        numbers: The numbers of the messages on their links; shape (m,).
        page: The number of the group of four draws of each message.

    Returns:
        Shape (4, m).
    """
    even, odd = philox(numbers.view(np.uint64), np.full(len(numbers), page, np.uint64), keys)
    drawn: Array = np.stack([even[0], odd[0], even[1], odd[1]]).astype(float)
    drawn += 0.5
    drawn *= _OF_32
    return drawn


def uniform(first: Numbers, second: Numbers, key: int | Numbers, width: int = 2) -> Array:
    """Draw numbers from [0, 1) for each counter, in steps of 2**-53; up to two, shape (m, width)."""
    drawn = np.empty((len(first), width))
    for begin in range(0, len(first), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        even, odd = philox(first[part], second[part], key if isinstance(key, int) else key[part])
        wide = even[:width].astype(np.uint64) << np.uint64(21)
        wide |= odd[:width] >> np.uint32(11)
        drawn[part] = (wide * _OF_53).T
    return drawn


def standard_normal(first: Numbers, second: Numbers, key: int | Numbers, width: int = 4) -> Array:
    """Draw standard normal numbers for each counter; up to four, shape (m, width).

    None exceeds 6.77 in magnitude, as they are made from 32-bit words; the probability of that is 10**-11.

    Source: G. E. P. Box and M. E. Muller, "A Note on the Generation of Random Normal Deviates", The Annals of
    Mathematical Statistics 29, 1958.
    """
    if _counts:
        _note_draw()
    return normals(first, second, key, width)


@compiled
def normals(first: Numbers, second: Numbers, key: int | Numbers, width: int) -> Array:
    """Draw as `standard_normal`, uncounted."""
    drawn, lanes = np.empty((len(first), width)), (width + 1) // 2
    for begin in range(0, len(first), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        even, odd = _scrambled(first[part], second[part], key if isinstance(key, int) else key[part])
        radius = even[:lanes] + 0.5
        radius *= _OF_32
        np.log(radius, out=radius)
        radius *= -2.0
        np.sqrt(radius, out=radius)
        angle = odd[:lanes] * _ANGLE
        pairs = width // 2
        for number, sines in enumerate(np.sin(angle[:pairs])):
            np.multiply(radius[number], sines, out=drawn[part, 2 * number + 1])
        for number, cosines in enumerate(np.cos(angle, out=angle)):
            np.multiply(radius[number], cosines, out=drawn[part, 2 * number])
    return drawn


@compiled
def digests(beginnings: Sequence[bytes], end: bytes) -> Numbers:
    """Return the first 64 bits of BLAKE2b, with a digest of that length, of each beginning with the end; shape (n,)."""
    joined = b"".join([blake2b(begin + end, digest_size=8).digest() for begin in beginnings])
    return np.frombuffer(joined, "<u8").astype(np.uint64, copy=False)


class GroupChance:
    """The draws of a group's agents for one purpose, such as a component: a row for each agent.

    Several draws of one kind in a turn give different numbers; draws of one kind, or in one turn, have no influence on
    others.
    """

    def __init__(self, seed: Seed, purpose: str, numbers: Numbers) -> None:
        """Start without draws.

        Args:
            seed: The seed of the run, or those of several runs, which have the same number of rows each.
            purpose: The purpose; the same for all agents, and different from all other purposes.
            numbers: The numbers of the agents, from `agent_numbers`; shape (n,).
        """
        self._purpose = purpose
        self._numbers = numbers
        self._seeds: tuple[int, ...] = ()
        #: How many rows each run has.
        self._share = 1
        #: How the text of a key begins, for each run.
        self._beginnings: list[bytes] = []
        self._turn = Turn(-1)
        self._used: dict[tuple[str, ...], int] = {}
        #: The time from the previous turn to this one [ns], and whether it equals the one before.
        self._step = 0
        self._is_regular = False
        self._ahead: dict[tuple[str | int, ...], _Ahead] = {}
        #: What the keys of some agents contain in addition, by their numbers; see `redraw`.
        self._redrawn: dict[tuple[int, int | None], str] = {}
        self.reseed(seed)

    def reseed(self, seed: Seed) -> None:
        """Draw from another seed from now on."""
        self._seeds = (seed,) if isinstance(seed, int) else tuple(seed)
        self._share = max(1, len(self._numbers) // len(self._seeds))
        self._beginnings = [f"{each}\0{self._purpose}\0".encode() for each in self._seeds]
        self._ahead = {}

    def redraw(self, agent: int, other: int | None, draw: str | None) -> None:
        """Use other keys for the draws about one pair of agents, or one agent alone; all other draws are unchanged.

        Args:
            agent: The number of the drawing agent, from `agent_numbers`.
            other: The number of the other agent; None for the draws that concern no other.
            draw: Distinguishes these keys from others; None to draw from the original ones again.
        """
        if draw is None:
            self._redrawn.pop((agent, other), None)
        else:
            self._redrawn[agent, other] = draw

    def at(self, turn: Turn) -> Self:
        """Select the draws of a turn; in the same turn as before, continue."""
        if turn != self._turn:
            step = turn.instant - self._turn.instant
            self._is_regular = step == self._step > 0
            self._step, self._turn, self._used = step, turn, {}
        return self

    def standard_normal(self, width: int, kind: str = "") -> Array:
        """Draw ``width`` standard normal numbers of some kind for every agent; shape (n, width)."""
        return self._rows(standard_normal, 4, width, kind)

    def uniform(self, width: int, kind: str = "") -> Array:
        """Draw ``width`` numbers from [0, 1) of some kind for every agent; shape (n, width)."""
        return self._rows(uniform, 2, width, kind)

    def standard_normal_of(self, rows: Indices, others: Numbers, width: int, kind: str = "") -> Array:
        """Draw standard normal numbers for pairs with others, independently of further agents.

        Args:
            rows: The drawing agents, as rows of the group; shape (m,).
            others: The numbers of the others, from `agent_numbers`; shape (m,).
            width: The number of draws for each pair.
            kind: The kind of draws.

        Returns:
            Shape (m, width).
        """
        return self._pairs(standard_normal, 4, rows, others, width, kind)

    def uniform_of(self, rows: Indices, others: Numbers, width: int, kind: str = "") -> Array:
        """Draw numbers from [0, 1) for pairs with others; see `standard_normal_of`."""
        return self._pairs(uniform, 2, rows, others, width, kind)

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_ahead": {}}

    def _rows(self, draw: Draw, most: int, width: int, kind: str) -> Array:
        pages = -(-width // most)
        purpose = ("each", draw.__name__, kind)
        begin = self._use(purpose, pages)
        numbers, count = self._numbers, len(self._numbers)
        if pages == 1:
            return self._drawn(draw, purpose, numbers, np.full(count, begin, np.uint64), width)
        counted = np.tile(np.arange(begin, begin + pages, dtype=np.uint64), count)
        drawn = self._drawn(draw, purpose, np.repeat(numbers, pages), counted, most)
        return np.ascontiguousarray(drawn.reshape(count, -1)[:, :width])

    def _pairs(self, draw: Draw, most: int, rows: Indices, others: Numbers, width: int, kind: str) -> Array:
        pages = -(-width // most)
        purpose = ("pairs", draw.__name__, kind)
        begin = self._use(purpose, pages)
        numbers = self._numbers[rows]
        drawn = [
            self._drawn(draw, (*purpose, begin + page), numbers, others, min(most, width - most * page), rows)
            for page in range(pages)
        ]
        return drawn[0] if pages == 1 else np.concatenate(drawn, axis=1)

    def _use(self, purpose: tuple[str, ...], pages: int) -> int:
        """Return how many pages a purpose has used in this turn, and count further ones."""
        begin = self._used.get(purpose, 0)
        self._used[purpose] = begin + pages
        return begin

    def _drawn(
        self,
        draw: Draw,
        purpose: tuple[str | int, ...],
        first: Numbers,
        second: Numbers,
        width: int,
        rows: Indices | None = None,
    ) -> Array:
        """Draw for some counters in this turn."""
        drawn = self._of_turn(draw, purpose, first, second, width, rows)
        for (agent, other), changed in self._redrawn.items():
            if (other is None) == (rows is None):
                chosen = first == agent if other is None else (first == agent) & (second == other)
                if chosen.any():
                    keys = self._key(self._turn, (*purpose, "redrawn", changed), len(first), rows)
                    own = keys if isinstance(keys, int) else keys[chosen]
                    drawn[chosen] = draw(first[chosen], second[chosen], own, width)
        return drawn

    def _of_turn(
        self,
        draw: Draw,
        purpose: tuple[str | int, ...],
        first: Numbers,
        second: Numbers,
        width: int,
        rows: Indices | None,
    ) -> Array:
        """Draw for some counters; few counters are drawn for several turns at once, which is faster."""
        turn, count = self._turn, len(first)
        turns = _AHEAD // max(count, 1)
        if not self._is_regular or turn.repetition or turns < _FEWEST_TURNS:
            return draw(first, second, self._key(turn, purpose, count, rows), width)
        known = self._ahead.get(purpose)
        if known is None or not known.is_for(first, second, width):
            # The pairs may differ from turn to turn: draw ahead only once the same ones are requested twice.
            self._ahead[purpose] = _Ahead(turn.instant, self._step, first, second, np.empty((0, count, width)))
            return draw(first, second, self._key(turn, purpose, count, rows), width)
        if not known.covers(turn.instant):
            turns = min(turns, _MOST_TURNS)
            expected = [Turn(turn.instant + number * self._step) for number in range(turns)]
            own = [self._key(each, purpose, count, rows) for each in expected]
            keys = np.concatenate([np.broadcast_to(np.array(each, np.uint64), count) for each in own])
            drawn = draw(np.tile(first, turns), np.tile(second, turns), keys, width).reshape(turns, count, width)
            known = self._ahead[purpose] = _Ahead(turn.instant, self._step, first, second, drawn)
        present: Array = known.drawn[(turn.instant - known.begin) // known.step]
        return present.copy()  # callers may write to it

    def _key(self, turn: Turn, purpose: tuple[str | int, ...], count: int, rows: Indices | None) -> int | Numbers:
        """The key of a purpose: one for all counters, or that of the run which each of them belongs to."""
        end = "\0".join(map(str, (*turn, *purpose))).encode()
        of_runs = digests(self._beginnings, end)
        if len(self._seeds) == 1:
            return int(of_runs[0])
        return np.repeat(of_runs, count // len(self._seeds)) if rows is None else of_runs[rows // self._share]


class _Ahead(NamedTuple):
    """Draws for probable future turns; drawing them again would give the same.

    Attributes:
        begin: The instant of the first turn, in nanoseconds.
        step: The time between turns, in nanoseconds.
        first: The first half of the counters; shape (m,).
        second: The second half; shape (m,).
        drawn: The numbers; shape (turns, m, width).
    """

    begin: int
    step: int
    first: Numbers
    second: Numbers
    drawn: Array

    def is_for(self, first: Numbers, second: Numbers, width: int) -> bool:
        """Return whether it is for these counters."""
        same = self.drawn.shape[2] == width and np.array_equal(self.first, first)
        return same and np.array_equal(self.second, second)

    def covers(self, instant: int) -> bool:
        """Return whether it contains the draws of an instant."""
        turn, beside = divmod(instant - self.begin, self.step)
        return 0 <= turn < len(self.drawn) and not beside


def generator(seed: int, path: str, turn: Turn | None = None) -> np.random.Generator:
    """Return the generator of a path, or that of a path in one turn."""
    return np.random.Generator(np.random.Philox(key=_generator_key(seed, path, turn)))


def _generator_key(seed: int, path: str, turn: Turn | None) -> NDArray[np.uint64]:
    if _counts:
        _note_draw()
    text = "\0".join(map(str, (seed, path, *(turn or ()))))
    return np.frombuffer(blake2b(text.encode(), digest_size=16).digest(), "<u8").astype(np.uint64)


class AgentChance:
    """The generator of one component of one agent, which is reset in each turn."""

    def __init__(self, seed: int, path: str) -> None:
        """Start without a generator.

        Args:
            seed: The seed of the run.
            path: The path of the component.
        """
        self._seed = seed
        self._path = path
        self._own_path = path
        self._turn: Turn | None = None
        self._generator: np.random.Generator | None = None

    def reseed(self, seed: int) -> None:
        """Draw from another seed from the next turn on."""
        self._seed = seed

    def redraw(self, draw: str | None) -> None:
        """Use other keys, distinguished by a text, from the next turn on; None for the original ones."""
        self._path = self._own_path if draw is None else f"{self._own_path} redrawn {draw}"

    def at(self, turn: Turn) -> np.random.Generator:
        """Return the generator of a turn: in its present state within the turn, else reset to the turn's beginning."""
        if self._generator is None:
            self._generator = generator(self._seed, self._path, turn)
        elif turn != self._turn:
            # Resetting costs a tenth of creating a new generator.
            self._generator.bit_generator.state = {
                "bit_generator": "Philox",
                "state": {"counter": _NOTHING, "key": _generator_key(self._seed, self._path, turn)},
                "buffer": _NOTHING,
                "buffer_pos": len(_NOTHING),
                "has_uint32": 0,
                "uinteger": 0,
            }
        self._turn = turn
        return self._generator


_NOTHING = np.zeros(4, np.uint64)
