"""The operators of ONNX that networks of policies may consist of, computed by `fixed_order`.

Each operator is prepared once: it checks the shapes of its inputs, and returns the shape of its output with a function.
One dimension of a value is that of the rows, None in a shape; all operators keep rows independent of each other. All
numbers are computed in double precision. The operators are defined at https://onnx.ai/onnx/operators.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning import fixed_order
from symaware_cli.learning.onnx_file import DOUBLE, FLOAT, OnnxError, OnnxNode, UnsupportedOperatorError

Array = NDArray[np.float64]

#: The dimensions of a value; None is the number of rows.
Shape = tuple[int | None, ...]


class Value(NamedTuple):
    """The properties of a value that are known before a network is computed.

    Attributes:
        shape: The shape of the value.
        constant: The elements, if they are the same for all inputs of the network: float64, or int64 for axes and
            shapes.
    """

    shape: Shape
    constant: NDArray[np.float64] | NDArray[np.int64] | None = None


#: Computes outputs from the inputs, without those that are left out.
Compute = Callable[..., Array | tuple[Array, ...]]


class Prepared(NamedTuple):
    """An operator that can be computed.

    Attributes:
        shapes: The shapes of its outputs.
        compute: Returns the output, or a tuple of outputs, from all inputs; an input that is left out is None.
        work: The number of multiplications for each row.
    """

    shapes: tuple[Shape, ...]
    compute: Compute
    work: int = 0


class Operands:
    """The inputs and attributes of an operator that is being prepared."""

    def __init__(self, node: OnnxNode, values: Sequence[Value | None]) -> None:
        self.node = node
        self.values = tuple(values)
        self._unread = set(node.attributes)

    def fail(self, message: str) -> OnnxError:
        """Return the error to raise."""
        return UnsupportedOperatorError(f"{self.node.label} {message}")

    def count(self, least: int, most: int) -> None:
        """Check the number of inputs."""
        if not least <= len(self.values) <= most or any(each is None for each in self.values[:least]):
            expected = str(least) if least == most else f"{least} to {most}"
            raise self.fail(f"has {len(self.values)} inputs, and {expected} are supported")

    def at(self, number: int) -> Value:
        """Return a required input, which must consist of numbers."""
        value = self.values[number] if number < len(self.values) else None
        if value is None:
            raise self.fail(f"lacks its input {number}")
        if value.constant is not None and value.constant.dtype != np.float64:
            raise self.fail(f"computes with integers as input {number}, which is not supported")
        return value

    def constant(self, number: int) -> Array:
        """Return a required input, which must be a constant of numbers."""
        found = self.at(number).constant
        if found is None:
            raise self.fail(f"has an input {number} that is no constant, which is not supported")
        return found.astype(np.float64)

    def optional(self, number: int) -> Array | None:
        """Return a constant, or None if the input is left out."""
        if number >= len(self.values) or self.values[number] is None:
            return None
        return self.constant(number)

    def number(self, name: str, default: float) -> float:
        """Return an attribute that is a number."""
        self._unread.discard(name)
        found = self.node.attributes.get(name, default)
        if not isinstance(found, int | float) or not math.isfinite(found):
            raise self.fail(f"has an attribute `{name}` that is not a finite number")
        return found

    def integer(self, name: str, default: int) -> int:
        """Return an attribute that is an integer."""
        found = self.number(name, default)
        if not isinstance(found, int):
            raise self.fail(f"has an attribute `{name}` that is not an integer")
        return found

    def only(self, name: str, default: str | int, *supported: str | int) -> None:
        """Check that an attribute has a supported value."""
        self._unread.discard(name)
        found = self.node.attributes.get(name, default)
        if not isinstance(found, str | int) or found not in supported:
            raise self.fail(f"has `{name}` {found}, and {' or '.join(map(str, supported))} is supported")

    def integers(self, name: str, number: int | None = None) -> list[int] | None:
        """Return integers from an attribute or a constant input; None if both are left out."""
        self._unread.discard(name)
        found = self.node.attributes.get(name)
        if found is None and number is not None and number < len(self.values):
            value = self.values[number]
            if value is not None:
                if value.constant is None or value.constant.dtype != np.int64 or value.constant.ndim > 1:
                    raise self.fail(f"has `{name}` that are no constant integers")
                return [int(each) for each in np.ravel(value.constant)]
        if found is None:
            return None
        if not isinstance(found, list) or any(not isinstance(each, int) for each in found):
            raise self.fail(f"has `{name}` that are no integers")
        return [int(each) for each in found]

    def finish(self) -> None:
        """Check that the operator has no attribute that was not read."""
        if self._unread:
            raise self.fail(f"has the attribute `{min(self._unread)}`, which is not supported")

    def axis(self, axis: int, length: int) -> int:
        """Return an axis from 0."""
        if not -length <= axis < length:
            raise self.fail(f"has the axis {axis} of {length}")
        return axis % length


def _broadcast(operands: Operands, shapes: Sequence[Shape]) -> Shape:
    """Return the shape of the result of an element-wise operation."""
    length = max(map(len, shapes))
    found: list[int | None] = []
    for place in range(length):
        dims = {shape[place - length] for shape in shapes if len(shape) >= length - place} - {1}
        if len(dims) > 1:
            raise operands.fail(f"combines the shapes {' and '.join(map(said, shapes))}")
        found.append(dims.pop() if dims else 1)
    if found.count(None) > 1:
        raise operands.fail(f"combines rows with rows in the shapes {' and '.join(map(said, shapes))}")
    return tuple(found)


def said(shape: Shape) -> str:
    """Return a shape as text for messages."""
    return "(" + ", ".join("rows" if each is None else str(each) for each in shape) + ")"


def _folded(function: Callable[[Array, Array], Array], least: int, most: int) -> Callable[[Operands], Prepared]:
    def prepare(operands: Operands) -> Prepared:
        operands.count(least, most)
        shape = _broadcast(operands, [operands.at(number).shape for number in range(len(operands.values))])

        def compute(first: Array, *others: Array) -> Array:
            for each in others:
                first = function(first, each)
            return first

        return Prepared((shape,), compute)

    return prepare


def _mapped(function: Callable[[Array], Array], work: int = 1) -> Callable[[Operands], Prepared]:
    def prepare(operands: Operands) -> Prepared:
        operands.count(1, 1)
        shape = operands.at(0).shape
        return Prepared((shape,), function, work * size(shape))

    return prepare


def size(shape: Shape) -> int:
    """Return the number of elements for each row."""
    return math.prod(1 if each is None else each for each in shape)


def _leaky(operands: Operands) -> Prepared:
    slope = operands.number("alpha", 0.01)
    return _mapped(lambda x: np.where(x < 0.0, slope * x, x))(operands)


def _elu(operands: Operands) -> Prepared:
    slope = operands.number("alpha", 1.0)
    return _mapped(lambda x: np.where(x < 0.0, slope * fixed_order.less_one(np.minimum(x, 0.0)), x), 20)(operands)


def _clip(operands: Operands) -> Prepared:
    operands.count(1, 3)
    bounds = [operands.optional(number) for number in (1, 2)]
    if any(bound is not None and bound.size != 1 for bound in bounds):
        raise operands.fail("has bounds that are not single numbers")
    low, high = (None if bound is None else float(bound.reshape(())) for bound in bounds)

    def compute(x: Array, *_: Array) -> Array:
        x = x if low is None else np.maximum(x, low)
        return x if high is None else np.minimum(x, high)

    return Prepared((operands.at(0).shape,), compute)


def _identity(operands: Operands) -> Prepared:
    operands.count(1, 1)
    return Prepared((operands.at(0).shape,), lambda x: x)


def _cast(operands: Operands) -> Prepared:
    if operands.integer("to", 0) not in (FLOAT, DOUBLE):
        raise operands.fail("converts to another type than float or double, which is not supported")
    operands.only("saturate", 1, 0, 1)
    return _identity(operands)


def _matmul(operands: Operands) -> Prepared:
    operands.count(2, 2)
    shape, weights = operands.at(0).shape, operands.constant(1)
    return _product(operands, shape, weights, None)


def _product(operands: Operands, shape: Shape, weights: Array, bias: Array | None) -> Prepared:
    if len(shape) < 2 or weights.ndim != 2 or shape[-1] != weights.shape[0]:
        raise operands.fail(f"multiplies {said(shape)} by {said(weights.shape)}")
    found = (*shape[:-1], weights.shape[1])
    if bias is not None and (bias.ndim > 2 or _broadcast(operands, [found, bias.shape]) != found):
        raise operands.fail(f"adds {said(bias.shape)} to {said(found)}")
    weights = np.ascontiguousarray(weights)
    work = size(shape[:-1]) * weights.size
    return Prepared((found,), lambda x, *_: fixed_order.product(x, weights, bias), work)


def _gemm(operands: Operands) -> Prepared:
    operands.count(2, 3)
    alpha, beta = operands.number("alpha", 1.0), operands.number("beta", 1.0)
    operands.only("transA", 0, 0)
    weights = operands.constant(1)
    if operands.integer("transB", 0):
        weights = weights.T
    bias = operands.optional(2)
    if len(operands.at(0).shape) != 2:
        raise operands.fail(f"multiplies {said(operands.at(0).shape)}")
    with np.errstate(over="ignore"):
        bias = None if bias is None else beta * bias
        return _product(operands, operands.at(0).shape, alpha * weights, bias)


def _flatten(operands: Operands) -> Prepared:
    operands.count(1, 1)
    shape = operands.at(0).shape
    axis = operands.integer("axis", 1)
    if axis not in (1, 1 - len(shape)) or len(shape) < 1 or None in shape[1:]:
        raise operands.fail(f"of {said(shape)} does not keep rows apart")
    width = math.prod(each or 0 for each in shape[1:])
    return Prepared(((shape[0], width),), lambda x: x.reshape(len(x), width))


def _squeeze(operands: Operands) -> Prepared:
    operands.count(1, 2)
    shape = operands.at(0).shape
    axes = operands.integers("axes", 1)
    if axes is None:
        raise operands.fail("does not name its axes, which is not supported")
    places = sorted({operands.axis(each, len(shape)) for each in axes})
    if any(shape[place] != 1 for place in places):
        raise operands.fail(f"removes axes of {said(shape)} that are not 1")
    found = tuple(each for place, each in enumerate(shape) if place not in places)
    return Prepared((found,), lambda x, *_: np.squeeze(x, tuple(places)))


def _unsqueeze(operands: Operands) -> Prepared:
    operands.count(1, 2)
    shape = operands.at(0).shape
    axes = operands.integers("axes", 1)
    if axes is None or len(shape) + len(axes) > 8:
        raise operands.fail("does not name its axes, or too many")
    length = len(shape) + len(axes)
    places = sorted({operands.axis(each, length) for each in axes})
    if len(places) != len(axes):
        raise operands.fail("names an axis twice")
    rest = iter(shape)
    found = tuple(1 if place in places else next(rest) for place in range(length))
    return Prepared((found,), lambda x, *_: np.expand_dims(x, tuple(places)))


def _transpose(operands: Operands) -> Prepared:
    operands.count(1, 1)
    shape = operands.at(0).shape
    order = operands.integers("perm")
    order = list(range(len(shape)))[::-1] if order is None else order
    if sorted(order) != list(range(len(shape))):
        raise operands.fail(f"has `perm` {order} of {len(shape)} axes")
    return Prepared((tuple(shape[each] for each in order),), lambda x: np.transpose(x, order))


def _gather(operands: Operands) -> Prepared:
    operands.count(2, 2)
    shape = operands.at(0).shape
    index = operands.values[1]
    axis = operands.axis(operands.integer("axis", 0), len(shape))
    if index is None or index.constant is None or index.constant.dtype != np.int64 or index.constant.ndim:
        raise operands.fail("has an index that is no constant integer, which is not supported")
    place, length = int(index.constant), shape[axis]
    if length is None or not -length <= place < length:
        raise operands.fail(f"takes element {place} along axis {axis} of {said(shape)}")
    found = (*shape[:axis], *shape[axis + 1 :])
    return Prepared((found,), lambda x, *_: np.take(x, place, axis))


def _concatenated(operands: Operands) -> Prepared:
    operands.count(1, 100)
    shapes = [operands.at(number).shape for number in range(len(operands.values))]
    axis = operands.axis(operands.integer("axis", 0), len(shapes[0]))
    others = {(*shape[:axis], *shape[axis + 1 :]) for shape in shapes if len(shape) == len(shapes[0])}
    if len(others) != 1 or any(len(shape) != len(shapes[0]) or shape[axis] is None for shape in shapes):
        raise operands.fail(f"joins the shapes {', '.join(map(said, shapes))}")
    total = sum(shape[axis] or 0 for shape in shapes)
    found = (*shapes[0][:axis], total, *shapes[0][axis + 1 :])
    return Prepared((found,), lambda *values: np.concatenate(values, axis))


def _gated(operands: Operands) -> Prepared:
    """Prepare a gated recurrent unit, for one instant of a sequence.

    The gates are in the order update, reset, hidden (K. Cho et al., "Learning phrase representations using RNN
    encoder-decoder for statistical machine translation", EMNLP 2014).
    """
    operands.count(3, 6)
    hidden = operands.integer("hidden_size", 0)
    operands.only("direction", "forward", "forward")
    operands.only("layout", 0, 0)
    operands.only("activations", "Sigmoid Tanh", "Sigmoid Tanh")
    operands.only("linear_before_reset", 0, 0, 1)
    resets_after = bool(operands.node.attributes.get("linear_before_reset", 0))
    shape, weights, recurrent = operands.at(0).shape, operands.constant(1), operands.constant(2)
    if len(shape) != 3 or shape[0] != 1 or shape[1] is not None or shape[2] is None:
        raise operands.fail(f"reads {said(shape)}, and (1, rows, values) is supported: one instant at a time")
    width = shape[2]
    if hidden < 1 or weights.shape != (1, 3 * hidden, width) or recurrent.shape != (1, 3 * hidden, hidden):
        shapes = f"(1, {3 * hidden}, {width}) and (1, {3 * hidden}, {hidden})"
        raise operands.fail(f"has weights of other shapes than {shapes}")
    bias = operands.optional(3)
    bias = np.zeros((1, 6 * hidden)) if bias is None else bias
    if bias.shape != (1, 6 * hidden):
        raise operands.fail(f"has a bias of the shape {said(bias.shape)}, not (1, {6 * hidden})")
    if len(operands.values) > 4 and operands.values[4] is not None:
        raise operands.fail("has lengths of sequences, which is not supported")
    begins = len(operands.values) > 5 and operands.values[5] is not None
    if begins and operands.at(5).shape not in ((1, None, hidden), (1, 1, hidden)):
        raise operands.fail(f"begins with {said(operands.at(5).shape)}, not (1, rows, {hidden})")
    inner, outer = np.ascontiguousarray(weights[0].T), np.ascontiguousarray(recurrent[0].T)
    inner_bias, outer_bias = bias[0, : 3 * hidden], bias[0, 3 * hidden :]
    gates, last = slice(0, 2 * hidden), slice(2 * hidden, 3 * hidden)
    outer_gates, outer_last = np.ascontiguousarray(outer[:, gates]), np.ascontiguousarray(outer[:, last])

    def compute(x: Array, *others: Array) -> tuple[Array, Array]:
        rows = x[0]
        before = np.zeros((len(rows), hidden))
        if begins:
            before = before + others[4][0]
        read = fixed_order.product(rows, inner, inner_bias)
        both = fixed_order.sigmoid(read[:, gates] + fixed_order.product(before, outer_gates, outer_bias[gates]))
        update, reset = both[:, :hidden], both[:, hidden:]
        if resets_after:
            kept = reset * fixed_order.product(before, outer_last, outer_bias[last])
        else:
            kept = fixed_order.product(reset * before, outer_last, outer_bias[last])
        new = fixed_order.tangent(read[:, last] + kept)
        after = (1.0 - update) * new + update * before
        return after[None, None], after[None]

    work = inner.size + outer.size + 60 * hidden
    return Prepared(((1, 1, None, hidden), (1, None, hidden)), compute, work)


#: The operators by name.
OPERATORS: Mapping[str, Callable[[Operands], Prepared]] = {
    "Abs": _mapped(np.abs),
    "Add": _folded(np.add, 2, 2),
    "Cast": _cast,
    "Clip": _clip,
    "Concat": _concatenated,
    "Div": _folded(np.divide, 2, 2),
    "Elu": _elu,
    "Exp": _mapped(fixed_order.exponential, 20),
    "Flatten": _flatten,
    "GRU": _gated,
    "Gather": _gather,
    "Gemm": _gemm,
    "Identity": _identity,
    "LeakyRelu": _leaky,
    "MatMul": _matmul,
    "Max": _folded(np.maximum, 1, 100),
    "Min": _folded(np.minimum, 1, 100),
    "Mul": _folded(np.multiply, 2, 2),
    "Neg": _mapped(np.negative),
    "Relu": _mapped(lambda x: np.maximum(x, 0.0)),
    "Sigmoid": _mapped(fixed_order.sigmoid, 20),
    "Sqrt": _mapped(np.sqrt),
    "Squeeze": _squeeze,
    "Sub": _folded(np.subtract, 2, 2),
    "Tanh": _mapped(fixed_order.tangent, 20),
    "Transpose": _transpose,
    "Unsqueeze": _unsqueeze,
}
