"""Writes policies that were trained without a library that exports ONNX."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.learning.onnx_file import DOUBLE
from symaware_cli.learning.protobuf_fields import message
from symaware_cli.version import __version__

Array = NDArray[np.float64]

#: The version of the format, and that of its operators.
_FORMAT, _OPERATORS = 8, 17


def write_policy(
    path: str | os.PathLike[str],
    layers: Sequence[tuple[ArrayLike, ArrayLike]],
    *,
    activation: Literal["Tanh", "Relu", "Elu", "Sigmoid"] = "Tanh",
    mean: ArrayLike = 0.0,
    deviation: ArrayLike = 1.0,
    low: ArrayLike = -1.0,
    high: ArrayLike = 1.0,
) -> Path:
    """Write a policy of dense layers as an ONNX file, with the normalisation of observations and the scale of actions.

    The mean is subtracted from the observation, and the result divided by the deviation. It passes through the layers,
    with the activation between two of them. The last output is clipped to [-1, 1] and mapped from there to [low, high].

    Args:
        path: The file.
        layers: Weights, shape (k, m), and bias, shape (m,), of each layer.
        activation: The function between two layers.
        mean: The value that is subtracted from observations; shape (k,) or a number.
        deviation: The divisor of observations, after the mean is subtracted; shape (k,) or a number.
        low: The least actions; shape (nu,) or a number.
        high: The greatest actions; shape (nu,) or a number.

    Returns:
        The path.

    Raises:
        ValueError: Shapes do not fit together.
    """
    pairs = [(np.asarray(weights, float), np.asarray(bias, float)) for weights, bias in layers]
    width = pairs[0][0].shape[0]
    for number, (weights, bias) in enumerate(pairs):
        if weights.ndim != 2 or weights.shape[0] != width or bias.shape != weights.shape[1:]:
            raise ValueError(f"layer {number} has weights {weights.shape} and a bias {bias.shape} for {width} values")
        width = weights.shape[1]
    observed = pairs[0][0].shape[0]
    least, greatest = (np.broadcast_to(np.asarray(each, float), (width,)) for each in (low, high))
    half = (greatest - least) / 2.0
    constants = {
        "mean": np.broadcast_to(np.asarray(mean, float), (observed,)),
        "deviation": np.broadcast_to(np.asarray(deviation, float), (observed,)),
        "one": np.array(1.0),
        "minus_one": np.array(-1.0),
        "half": half,
        "middle": least + half,
        **{f"weights.{number}": weights for number, (weights, _) in enumerate(pairs)},
        **{f"bias.{number}": bias for number, (_, bias) in enumerate(pairs)},
    }

    def nodes() -> Iterator[bytes]:
        yield _node("Sub", ["observation", "mean"], "centred")
        yield _node("Div", ["centred", "deviation"], "layer.0")
        for number in range(len(pairs)):
            yield _node("Gemm", [f"layer.{number}", f"weights.{number}", f"bias.{number}"], f"sum.{number}")
            if number < len(pairs) - 1:
                yield _node(activation, [f"sum.{number}"], f"layer.{number + 1}")
        yield _node("Clip", [f"sum.{len(pairs) - 1}", "minus_one", "one"], "clipped")
        yield _node("Mul", ["clipped", "half"], "scaled")
        yield _node("Add", ["scaled", "middle"], "action")

    graph = message(
        [
            *((1, each) for each in nodes()),
            (2, "policy"),
            *((5, _tensor(name, np.ascontiguousarray(each))) for name, each in constants.items()),
            (11, _value("observation", observed)),
            (12, _value("action", width)),
        ]
    )
    operators = message([(1, ""), (2, _OPERATORS)])
    content = message([(1, _FORMAT), (2, "symaware-cli"), (3, __version__), (7, graph), (8, operators)])
    target = Path(path)
    target.write_bytes(content)
    return target


def _node(operator: str, inputs: Sequence[str], output: str) -> bytes:
    return message([*((1, each) for each in inputs), (2, output), (3, output), (4, operator)])


def _tensor(name: str, values: Array) -> bytes:
    return message([*((1, each) for each in values.shape), (2, DOUBLE), (8, name), (9, values.astype("<f8").tobytes())])


def _value(name: str, width: int) -> bytes:
    shape = message([(1, message([(2, "rows")])), (1, message([(1, width)]))])
    return message([(1, name), (2, message([(1, message([(1, DOUBLE), (2, shape)]))]))])
