"""Networks of policies: actions from observations, row by row."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.network_operators import OPERATORS, Compute, Operands, Shape, Value, said, size
from symaware_cli.learning.onnx_file import (
    OnnxError,
    OnnxGraph,
    OnnxNode,
    OnnxValue,
    UnsupportedOperatorError,
    parse,
    read_bounded,
)

Array = NDArray[np.float64]

#: The most elements of all values for each row, and the most multiplications for each row.
_MOST_ELEMENTS, _MOST_WORK = 2**23, 2**25


class _Step(NamedTuple):
    """An operator that computes values from values, given by their numbers; None for an input that is left out."""

    compute: Compute
    inputs: tuple[int | None, ...]
    outputs: tuple[int, ...]


class ActionNetwork(ABC):
    """A network that maps an observation, and perhaps its state, to an action and the next state.

    The first input of the graph is the observation, of the shape (rows, values), and its first output the action. Each
    further input is a part of the state, initially 0, and the output at the same position is its next value. A graph
    with one input may have further outputs, which are ignored.

    Attributes:
        observed: The number of values of an observation.
        actions: The number of values of an action.
        states: The shapes of the parts of the state, in which None is the number of rows.
    """

    observed: int
    actions: int
    states: tuple[Shape, ...]

    def initial_states(self, rows: int) -> tuple[Array, ...]:
        """Return the initial state of a number of rows."""
        return tuple(np.zeros([rows if each is None else each for each in shape]) for shape in self.states)

    @abstractmethod
    def __call__(self, observations: Array, states: Sequence[Array] = ()) -> tuple[Array, tuple[Array, ...]]:
        """Compute actions; the result for a row does not depend on other rows.

        Args:
            observations: Shape (rows, observed).
            states: The state of each row, as `initial_states` and earlier calls return it.

        Returns:
            The actions, shape (rows, actions), and the next states.
        """


class PolicyNetwork(ActionNetwork):
    """A network that is computed by the kernels of this package."""

    def __init__(self, graph: OnnxGraph) -> None:
        """Prepare.

        Raises:
            OnnxError: The graph contains an unsupported feature.
        """
        self._values: list[Value] = []
        self._numbers: dict[str, int] = {}
        self._steps: list[_Step] = []
        self._elements = self._work = 0
        if not graph.inputs or not graph.outputs:
            raise OnnxError("its graph has no input or no output")
        shapes = [input_shape(each, number) for number, each in enumerate(graph.inputs)]
        for name, values in graph.constants.items():
            self._add(name, Value(values.shape, values), "a constant")
        for each, shape in zip(graph.inputs, shapes, strict=True):
            self._add(each.name, Value(shape), "an input")
        for node in graph.nodes:
            self._prepare(node)
        self._inputs = [self._numbers[each.name] for each in graph.inputs]
        self._constants = [each.constant for each in self._values]
        self.states: tuple[Shape, ...] = tuple(shapes[1:])
        if len(graph.outputs) <= len(self.states):
            count = f"{len(graph.outputs)} outputs"
            raise OnnxError(f"its {count} are not an action and the next of {len(self.states)} states")
        self._outputs = [self._output(each.name, number) for number, each in enumerate(graph.outputs[: len(shapes)])]
        found = self._values[self._outputs[0]].shape
        if len(found) != 2 or found[0] is not None or not found[1]:
            raise OnnxError(f"its first output has the shape {said(found)}, and an action has (rows, values)")
        self.observed, self.actions = shapes[0][1] or 0, found[1]

    @staticmethod
    def read(path: Path, name: str) -> PolicyNetwork:
        """Read a file.

        Args:
            path: The file.
            name: The name of the file, for messages.

        Raises:
            OnnxError: The file cannot be read, is damaged, or contains an unsupported feature.
        """
        content = read_bounded(path, name)
        try:
            return _network(content)
        except UnsupportedOperatorError as error:
            raise OnnxError(f"{name}: {error}; `runtime: onnxruntime` computes other operators") from error
        except OnnxError as error:
            raise OnnxError(f"{name}: {error}") from error

    def _add(self, name: str, value: Value, what: str) -> int:
        if not name:
            raise OnnxError(f"{what} has no name")
        if name in self._numbers:
            raise OnnxError(f"`{name}` is computed twice, the second time as {what}")
        self._elements += size(value.shape)
        if self._elements > _MOST_ELEMENTS:
            raise OnnxError(f"its values have more than {_MOST_ELEMENTS:,} elements for each row")
        self._numbers[name] = len(self._values)
        self._values.append(value)
        return self._numbers[name]

    def _output(self, name: str, number: int) -> int:
        found = self._numbers.get(name)
        if found is None:
            raise OnnxError(f"its output `{name}` is not computed")
        value = self._values[found]
        if value.constant is not None and value.constant.dtype != np.float64:
            raise OnnxError(f"its output `{name}` consists of integers")
        if number and value.shape != self.states[number - 1]:
            expected = said(self.states[number - 1])
            raise OnnxError(f"its output `{name}` has the shape {said(value.shape)}, not that of its state, {expected}")
        return found

    def _prepare(self, node: OnnxNode) -> None:
        """Prepare an operator, and compute it if its inputs are constant."""
        if node.operator == "Constant":
            self._constant(node)
            return
        prepare = OPERATORS.get(node.operator)
        if prepare is None:
            known = ", ".join(OPERATORS)
            raise UnsupportedOperatorError(
                f"{node.label} is an operator that is not supported; supported are Constant, {known}"
            )
        numbers: list[int | None] = []
        for name in node.inputs:
            if name and name not in self._numbers:
                raise OnnxError(f"{node.label} reads `{name}` before it is computed, or in a cycle")
            numbers.append(self._numbers[name] if name else None)
        values = [None if number is None else self._values[number] for number in numbers]
        operands = Operands(node, values)
        found = prepare(operands)
        operands.finish()
        if any(shape.count(None) > 1 or len(shape) > 8 for shape in found.shapes):
            raise operands.fail("has an output of too many dimensions")
        if not 1 <= len(node.outputs) <= len(found.shapes):
            raise operands.fail(f"has {len(node.outputs)} outputs, not 1 to {len(found.shapes)}")
        made = sum(map(size, found.shapes))
        self._work += found.work + made
        if self._work > _MOST_WORK or self._elements + made > _MOST_ELEMENTS:
            raise operands.fail(f"is one too many: the network takes more than {_MOST_WORK:,} operations for each row")
        constants = [None if each is None else each.constant for each in values]
        if all(each is None or each.constant is not None for each in values):
            with np.errstate(all="ignore"):
                computed = found.compute(*constants)
            results = computed if isinstance(computed, tuple) else (computed,)
            for name, result in zip(node.outputs, results, strict=False):
                if name:
                    self._add(name, Value(result.shape, result), f"an output of {node.label}")
            return
        outputs = [
            self._add(name, Value(shape), f"an output of {node.label}") if name else -1
            for name, shape in zip(node.outputs, found.shapes, strict=False)
        ]
        self._steps.append(_Step(found.compute, tuple(numbers), tuple(outputs)))

    def _constant(self, node: OnnxNode) -> None:
        if len(node.attributes) != 1 or len(node.outputs) != 1:
            raise OnnxError(f"{node.label} has not one attribute and one output")
        ((key, value),) = node.attributes.items()
        if key not in ("value", "value_float", "value_floats", "value_int", "value_ints") or isinstance(value, str):
            raise OnnxError(f"{node.label} has the attribute `{key}`, which is not supported")
        integers = key in ("value_int", "value_ints")
        array: NDArray[Any]
        array = value if isinstance(value, np.ndarray) else np.array(value, np.int64 if integers else np.float64)
        if array.dtype == np.float64 and not np.isfinite(array).all():
            raise OnnxError(f"{node.label} has an element that is not finite")
        self._add(node.outputs[0], Value(array.shape, array), f"an output of {node.label}")

    def __call__(self, observations: Array, states: Sequence[Array] = ()) -> tuple[Array, tuple[Array, ...]]:
        """Compute actions; see `ActionNetwork`."""
        values: list[Any] = list(self._constants)
        for number, given in zip(self._inputs, (observations, *states), strict=True):
            values[number] = given
        with np.errstate(all="ignore"):
            for compute, inputs, outputs in self._steps:
                found = compute(*[None if number is None else values[number] for number in inputs])
                for number, each in zip(outputs, found if isinstance(found, tuple) else (found,), strict=False):
                    if number >= 0:
                        values[number] = each
        rows = len(observations)
        results = []
        for number in self._outputs:
            shape = [rows if each is None else each for each in self._values[number].shape]
            results.append(np.array(np.broadcast_to(values[number], shape)))
        return results[0], tuple(results[1:])


def input_shape(value: OnnxValue, number: int) -> Shape:
    """Return the shape of an input, with None for the number of rows.

    Args:
        value: The input.
        number: Its position; 0 for the observation.

    Raises:
        OnnxError: It has another shape than an observation or a state.
    """
    if value.shape is None:
        raise OnnxError(f"the shape of its input `{value.name}` is unknown")
    length = len(value.shape)
    if number == 0 and length != 2:
        raise OnnxError(f"its input `{value.name}` has {length} dimensions, and an observation has (rows, values)")
    if length not in (2, 3):
        raise OnnxError(f"its input `{value.name}` has {length} dimensions, and a state has 2 or 3")
    rows = length - 2  # as states of recurrent units have: (layers, rows, values)
    shape: list[int | None] = []
    for place, each in enumerate(value.shape):
        if place == rows and (each == 1 or isinstance(each, str)):
            shape.append(None)
        elif isinstance(each, int) and 1 <= each <= _MOST_ELEMENTS and place != rows:
            shape.append(each)
        else:
            which = "rows, which is 1 or a name" if place == rows else f"dimension {place}, which is a number"
            raise OnnxError(f"its input `{value.name}` has `{each}` as its {which}")
    return tuple(shape)


@lru_cache(maxsize=8)
def _network(content: bytes) -> PolicyNetwork:
    return PolicyNetwork(parse(content))
