"""ONNX files of networks, written field by field: like those that libraries export, and invalid ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.protobuf_fields import message

#: Types of elements by their numbers in the format.
ELEMENTS = {"<f4": 1, "<i8": 7, "<f8": 11}

#: Dimensions; a text denotes the number of rows.
Dimensions = Sequence[int | str]


def tensor(values: NDArray[Any], name: str = "") -> bytes:
    kind = ELEMENTS[values.dtype.str]
    return message([*((1, each) for each in values.shape), (2, kind), (8, name), (9, values.tobytes())])


def attribute(name: str, value: Any) -> bytes:
    match value:
        case int():
            return message([(1, name), (3, value), (20, 2)])
        case float():
            return message([(1, name), (2, value), (20, 1)])
        case str():
            return message([(1, name), (4, value), (20, 3)])
        case list():
            return message([(1, name), *((8, each) for each in value), (20, 7)])
    return message([(1, name), (5, tensor(value)), (20, 4)])


def node(operator: str, inputs: Sequence[str], outputs: Sequence[str], domain: str = "", **attributes: Any) -> bytes:
    return message(
        [
            *((1, each) for each in inputs),
            *((2, each) for each in outputs),
            (4, operator),
            *((5, attribute(key, value)) for key, value in attributes.items()),
            (7, domain),
        ]
    )


def value(name: str, shape: Dimensions | None) -> bytes:
    kind: list[tuple[int, int | float | str | bytes]] = [(1, 1)]
    if shape is not None:
        dims = [message([(1, each) if isinstance(each, int) else (2, each)]) for each in shape]
        kind.append((2, message([(1, each) for each in dims])))
    return message([(1, name), (2, message([(1, message(kind))]))])


def model(
    nodes: Sequence[bytes],
    constants: Mapping[str, NDArray[Any]],
    inputs: Mapping[str, Dimensions | None],
    outputs: Sequence[str],
    version: int = 17,
) -> bytes:
    graph = message(
        [
            *((1, each) for each in nodes),
            *((5, tensor(each, name)) for name, each in constants.items()),
            *((11, value(name, shape)) for name, shape in inputs.items()),
            *((12, value(name, None)) for name in outputs),
        ]
    )
    return message([(1, 8), (7, graph), (8, message([(1, ""), (2, version)]))])


def numbers(*shape: int, seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).standard_normal(shape).astype("<f4")


def dense() -> bytes:
    """Return a network of 5 observed values and 2 actions with all operators that act on elements."""
    return model(
        [
            node("Gemm", ["x", "w0", "b0"], ["a"], transB=1),
            node("Tanh", ["a"], ["b"]),
            node("MatMul", ["b", "w1"], ["c"]),
            node("Add", ["c", "b1"], ["d"]),
            node("Elu", ["d"], ["e"], alpha=0.75),
            node("Sigmoid", ["e"], ["s"]),
            node("LeakyRelu", ["d"], ["l"], alpha=0.25),
            node("Concat", ["s", "l"], ["k"], axis=-1),
            node("Constant", [], ["low"], value=np.array(-2.0, "<f4")),
            node("Gemm", ["k", "w2"], ["y"]),
            node("Clip", ["y", "low"], ["u"]),
        ],
        {"w0": numbers(16, 5), "b0": numbers(16), "w1": numbers(16, 8), "b1": numbers(8), "w2": numbers(16, 2)},
        {"x": ("rows", 5)},
        ["u"],
    )


def recurrent(linear_before_reset: int = 1) -> bytes:
    """Return a network of 4 observed values and 2 actions with a gated recurrent unit of 6 values."""
    return model(
        [
            node("Unsqueeze", ["x", "first"], ["one"]),
            node(
                "GRU",
                ["one", "w", "r", "b", "", "before"],
                ["y", "after"],
                hidden_size=6,
                linear_before_reset=linear_before_reset,
            ),
            node("Squeeze", ["y", "two"], ["flat"]),
            node("Gemm", ["flat", "wy"], ["u"], transB=1),
        ],
        {
            "first": np.array([0], "<i8"),
            "two": np.array([0, 1], "<i8"),
            "w": numbers(1, 18, 4),
            "r": numbers(1, 18, 6, seed=1),
            "b": numbers(1, 36, seed=2),
            "wy": numbers(2, 6, seed=3),
        },
        {"x": (1, 4), "before": (1, 1, 6)},
        ["u", "after"],
    )
