"""Every compiled function returns the bits of the function in NumPy that it takes the place of."""

from __future__ import annotations

import importlib
import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import symaware_compiled
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from symaware_cli import open_log
from symaware_cli.geometry import compiled_functions
from symaware_cli.log.digest import digest

# The modules that mark functions.
for _module in (
    "geometry.proximity",
    "world.model",
    "world.chance",
    "engine.models.heading",
    "engine.components.control.steering",
):
    importlib.import_module(f"symaware_cli.{_module}")

REFERENCES = compiled_functions.REFERENCES

CROSSING = Path(__file__).parents[3] / "scenarios" / "crossing.yaml"

#: Numbers at which functions change, beside any others.
CORNERS = [0.0, -0.0, 1e-9, 1e-12, 5e-324, np.pi, -np.pi, 2 * np.pi, 1e15, 1.7e308, np.inf, -np.inf, np.nan]

numbers = st.one_of(st.floats(-10, 10), st.sampled_from(CORNERS), st.floats())
seeds = st.integers(0, 2**32 - 1)


def rows(draw: st.DrawFn, count: int, width: int) -> NDArray[np.float64]:
    """Draw an array (count, width): mostly plain numbers, some of them special, in one of several layouts."""
    values = np.random.default_rng(draw(seeds)).normal(size=(count, width)) * draw(st.sampled_from([1e-8, 1.0, 1e3]))
    for place in draw(st.lists(st.tuples(st.integers(0, count - 1), st.integers(0, width - 1)), max_size=4)):
        values[place] = draw(numbers)
    layout = draw(st.sampled_from(["rows", "columns", "part", "backwards"]))
    if layout == "columns":
        return np.asfortranarray(values)
    if layout == "part":
        wide = np.zeros((2 * count, width + 3))
        wide[::2, 1 : width + 1] = values
        return wide[::2, 1 : width + 1]
    return values[::-1] if layout == "backwards" else values


def column(draw: st.DrawFn, count: int) -> NDArray[np.float64]:
    """Draw an array (count,)."""
    values: NDArray[np.float64] = rows(draw, count, 2)[:, 1]
    return values


def some_pairs(draw: st.DrawFn, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Draw indices of pairs of bodies."""
    pairs = np.random.default_rng(draw(seeds)).integers(0, count, (2, draw(st.integers(0, 40))))
    return np.ascontiguousarray(pairs[0]), np.ascontiguousarray(pairs[1])


def some_blocks(draw: st.DrawFn, count: int) -> NDArray[np.intp]:
    """Draw the bodies at each place of some runs."""
    shape = draw(st.integers(1, 5)), draw(st.integers(1, 9))
    return np.random.default_rng(draw(seeds)).integers(0, count, shape)


def counters(draw: st.DrawFn, count: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64], Any]:
    """Draw counters, with one key for all or one for each."""
    count *= draw(st.sampled_from([1, 60]))
    generator = np.random.default_rng(draw(seeds))
    first, second, keys = generator.integers(0, 2**64, (3, count), dtype=np.uint64)
    return first, second, draw(st.sampled_from([keys, int(keys[0])]))


texts = st.binary(max_size=70)
positive = st.floats(1e-3, 10.0)

#: Arguments of each function for a number of agents.
ARGUMENTS: dict[str, Callable[[st.DrawFn, int], tuple[Any, ...]]] = {
    "lengths": lambda draw, count: (rows(draw, count, draw(st.integers(1, 4))),),
    "pair_distances": lambda draw, count: (rows(draw, count, draw(st.integers(1, 3))), *some_pairs(draw, count)),
    "block_distances": lambda draw, count: (rows(draw, count, draw(st.integers(1, 3))), some_blocks(draw, count)),
    "saturated": lambda draw, count: tuple(rows(draw, count, 2) for _ in range(3)),
    "approach": lambda draw, count: (rows(draw, count, 2), rows(draw, count, 2), draw(positive), draw(positive)),
    "aimed": lambda draw, count: (rows(draw, count, 4), rows(draw, count, draw(st.integers(2, 3))), 2),
    "steered": lambda draw, count: (column(draw, count), column(draw, count), draw(positive)),
    "arc_ends": lambda draw, count: (rows(draw, count, 3), rows(draw, count, 2), draw(positive)),
    "normals": lambda draw, count: (*counters(draw, count), draw(st.integers(1, 4))),
    "digests": lambda draw, count: (
        draw(st.lists(st.binary(max_size=80), max_size=count)),
        draw(st.binary(max_size=60)),
    ),
}


def same_bits(one: Any, other: Any) -> bool:
    """Whether arrays have equal bits, where one NaN is like another."""
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same_bits, one, other))
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    alike = one.copy().view(np.int64) == other.copy().view(np.int64) if one.dtype == float else one == other
    return bool((alike | (np.isnan(one) & np.isnan(other))).all())


def reference(name: str, *arguments: Any) -> Any:
    """What the function in NumPy returns; it warns of NaN and overflow, which is not compared."""
    with np.errstate(all="ignore"):
        return REFERENCES[name](*arguments)


def test_it_is_in_use_where_it_is_installed() -> None:
    """The functions of SymAware are the compiled ones."""
    from symaware_cli.geometry import lengths

    assert not compiled_functions.why_not_compiled()
    assert lengths is symaware_compiled.lengths
    assert not inspect.isfunction(lengths)


def test_each_marked_function_is_compiled_and_compared() -> None:
    """No function is marked without a compiled one, and none is compared with nothing."""
    compiled = {name for name in REFERENCES if symaware_compiled.replaced(REFERENCES[name]) is not REFERENCES[name]}
    assert compiled == {*REFERENCES} == {*ARGUMENTS}


@pytest.mark.parametrize("name", ARGUMENTS)
@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_bits_are_those_of_numpy(name: str, data: st.DataObject) -> None:
    """For any numbers, numbers of rows and layouts."""
    arguments = data.draw(
        st.composite(lambda draw: ARGUMENTS[name](draw, draw(st.integers(1, 70) | st.integers(190, 220))))()
    )
    assert same_bits(getattr(symaware_compiled, name)(*arguments), reference(name, *arguments))


@pytest.mark.parametrize("name", ["lengths", "saturated", "approach", "aimed", "steered", "arc_ends"])
def test_the_bits_of_a_row_do_not_depend_on_the_number_of_rows(name: str) -> None:
    """A row alone gives the bits that it gives among a thousand."""
    generator = np.random.default_rng(3)
    shapes: dict[str, list[tuple[int, ...]]] = {
        "lengths": [(1000, 3)],
        "saturated": [(1000, 2)] * 3,
        "approach": [(1000, 2), (1000, 2), (), ()],
        "aimed": [(1000, 3), (1000, 2), ()],
        "steered": [(1000,), (1000,), ()],
        "arc_ends": [(1000, 3), (1000, 2), ()],
    }
    single: Any = 2 if name == "aimed" else 1.3
    many = [generator.normal(size=shape) if shape else single for shape in shapes[name]]
    function = getattr(symaware_compiled, name)
    whole = function(*many)
    for row in (0, 1, 7, 500, 999):
        part = function(*(each[row : row + 1] if isinstance(each, np.ndarray) else each for each in many))
        of_row = tuple(each[row : row + 1] for each in whole) if isinstance(whole, tuple) else whole[row : row + 1]
        assert same_bits(part, of_row)


@pytest.mark.slow
def test_ten_million_angles_have_the_bits_of_numpy() -> None:
    """Sines, cosines, arctangents and remainders, whose last bits no standard fixes."""
    generator = np.random.default_rng(11)
    for scale in (1e-6, 1.0, 30.0, 1e4, 1e9):
        for _ in range(20):
            state = generator.normal(size=(100_000, 3)) * scale
            given = generator.normal(size=(100_000, 2)) * scale
            for name, arguments in {"arc_ends": (state, given, 0.05), "aimed": (state, given, 2)}.items():
                assert same_bits(getattr(symaware_compiled, name)(*arguments), reference(name, *arguments))
            error = given[:, 1].copy()
            assert same_bits(symaware_compiled.steered(error, error, 4.0), reference("steered", error, error, 4.0))


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("lengths", (np.array([[3, 4]]),)),
        ("lengths", (np.array([[3.0, 4.0]], np.float32),)),
        ("lengths", (np.array([[3.0, 4.0]], ">f8"),)),
        ("pair_distances", (np.zeros((3, 2)), np.array([0], np.int32), np.array([1], np.int32))),
        ("approach", (np.zeros((1, 2)), np.ones((3, 2)), 1.0, 1.0)),
        ("approach", (np.zeros((2, 2)), np.ones((2, 2)), np.array([1.0, 2.0]), 1.0)),
        ("saturated", (np.zeros((2, 2)), np.array([0.0, 1.0]), np.array([2.0, 2.0]))),
        ("aimed", (np.zeros((2, 3)), np.ones((1, 2)), 2)),
        ("steered", (np.zeros(2), np.ones(1), 1.0)),
        ("arc_ends", (np.zeros((2, 3)), np.ones((1, 2)), 0.1)),
        ("normals", (np.arange(6, dtype=np.uint64)[::2], np.arange(3, dtype=np.uint64), 7, 2)),
        ("digests", ((b"a", b"b"), b"c")),
        ("digests", ([b"a" * 129], b"")),
    ],
)
def test_other_arguments_are_handed_to_numpy(name: str, arguments: tuple[Any, ...]) -> None:
    """Other types, and shapes that NumPy repeats."""
    assert same_bits(getattr(symaware_compiled, name)(*arguments), reference(name, *arguments))


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("pair_distances", (np.zeros((2, 2)), np.array([0]), np.array([2]))),
        ("pair_distances", (np.zeros((2, 2)), np.array([-1]), np.array([1]))),
        ("pair_distances", (np.zeros((2, 2)), np.array([0, 1]), np.array([1]))),
        ("block_distances", (np.zeros((2, 2)), np.array([[0], [5]]))),
    ],
)
def test_bodies_that_do_not_exist_are_an_error(name: str, arguments: tuple[Any, ...]) -> None:
    """Nothing outside of the array is read."""
    with pytest.raises((IndexError, ValueError)):
        getattr(symaware_compiled, name)(*arguments)


def test_a_run_has_the_digest_that_it_has_without_it(tmp_path: Path) -> None:
    """All that the log states of the run, in processes with and without the package."""
    digests = []
    for state in ("with", "without"):
        log = tmp_path / f"{state}.mcap"
        begin = "import sys; sys.modules['symaware_compiled'] = None; " if state == "without" else ""
        run = f"Scenario({str(CROSSING)!r}).run(duration=3.0, output={str(log)!r})"
        program = f"{begin}from symaware_cli import Scenario; {run}"
        subprocess.run([sys.executable, "-c", program], check=True, env=dict(os.environ), stdout=subprocess.DEVNULL)
        digests.append(digest(open_log(log)).combined)
    assert digests[0] == digests[1]


def test_another_edition_is_not_used() -> None:
    """A package whose functions are of another edition might return other bits."""
    program = (
        "import symaware_compiled; symaware_compiled.EDITION = 0\n"
        "from symaware_cli.geometry.compiled_functions import why_not_compiled\n"
        "from symaware_cli.geometry import lengths\n"
        "print(type(lengths).__name__, why_not_compiled())"
    )
    result = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert result.stdout.startswith("function symaware_compiled has edition 0")
