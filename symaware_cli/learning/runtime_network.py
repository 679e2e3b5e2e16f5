"""Networks of policies that onnxruntime computes, for operators without a kernel of this package.

Reasons: docs/decisions/0112-policies-of-other-operators.md
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.network_operators import Shape, said
from symaware_cli.learning.onnx_file import OnnxError, OnnxGraph, parse, read_bounded
from symaware_cli.learning.policy_network import ActionNetwork, input_shape

Array = NDArray[np.float64]

#: How the library computes, as logs state it: one observation at a time, without threads, and without rewriting the
#: graph, which would depend on the version and the processor. `memory` is a limit for the values of operators [bytes].
SETTINGS: Mapping[str, int | str] = {
    "runtime": "onnxruntime",
    "provider": "CPUExecutionProvider",
    "intra_op_num_threads": 1,
    "inter_op_num_threads": 1,
    "execution_mode": "ORT_SEQUENTIAL",
    "graph_optimization_level": "ORT_DISABLE_ALL",
    "rows": 1,
    "memory": 2**28,
}

#: What the library writes before the text of an error: its kind, and the place in its source.
_PREFIX = re.compile(r"\[ONNXRuntimeError\] : \d+ : \w+ : |/onnxruntime_src/\S+:\d+ [^)]*\)(?: const)? ")

#: Operators that draw numbers, which no seed of a run determines.
_RANDOM = (
    "Bernoulli",
    "Dropout",
    "Multinomial",
    "RandomNormal",
    "RandomNormalLike",
    "RandomUniform",
    "RandomUniformLike",
)

_TYPES: Mapping[str, np.dtype[Any]] = {"tensor(float)": np.dtype(np.float32), "tensor(double)": np.dtype(np.float64)}


class RuntimeNetwork(ActionNetwork):
    """A network as `PolicyNetwork` is one, computed by onnxruntime for each row by itself."""

    def __init__(self, graph: OnnxGraph, content: bytes) -> None:
        """Prepare, and compute the action for an observation of zeros.

        Args:
            graph: The content of the file.
            content: The file.

        Raises:
            OnnxError: The graph contains an unsupported feature, or the library is missing or refuses it.
        """
        if graph.has_functions:
            raise OnnxError("it defines functions, or a graph for training, which is not supported")
        for node in graph.nodes:
            if node.operator in _RANDOM:
                raise OnnxError(f"{node.label} is an operator that may draw random numbers, which is not supported")
        if not graph.inputs or len(graph.outputs) < len(graph.inputs):
            count = f"{len(graph.inputs)} inputs and {len(graph.outputs)} outputs"
            raise OnnxError(f"its {count} are not an observation and states, and an action and the next of each state")
        shapes = [input_shape(each, number) for number, each in enumerate(graph.inputs)]
        self.states = tuple(shapes[1:])
        self.observed = shapes[0][1] or 0
        self._inputs = [each.name for each in graph.inputs]
        self._outputs = [each.name for each in graph.outputs[: len(shapes)]]
        self._axes = [shape.index(None) for shape in shapes]
        try:
            self._session = _session(content)
            types = {each.name: each.type for each in self._session.get_inputs()}
        except Exception as error:  # those of the library have no other base class
            raise _refused(error) from error
        try:
            self._types = [_TYPES[types[name]] for name in self._inputs]
        except KeyError as error:
            raise OnnxError(f"its inputs are {types}, and those of policies float or double") from error
        self._shapes: list[tuple[int, ...]] = []
        found = self._row([np.zeros([1 if each is None else each for each in shape]) for shape in shapes])
        for name, each, shape in zip(self._outputs, found, (None, *self.states), strict=True):
            self._check(name, each.shape, shape)
        self._shapes = [each.shape for each in found]
        self.actions = self._shapes[0][1]

    @staticmethod
    def read(path: Path, name: str) -> RuntimeNetwork:
        """Read a file; see `PolicyNetwork.read`."""
        content = read_bounded(path, name)
        try:
            return _network(content)
        except OnnxError as error:
            raise OnnxError(f"{name}: {error}") from error

    @staticmethod
    def _check(name: str, found: tuple[int, ...], state: Shape | None) -> None:
        """Check the shape of an output for one row: the action if `state` is None, else the next state."""
        if state is None and (len(found) != 2 or found[0] != 1 or not found[1]):
            raise OnnxError(f"its first output `{name}` has the shape {said(found)}, and an action has (1, values)")
        if state is not None and found != tuple(1 if each is None else each for each in state):
            raise OnnxError(f"its output `{name}` has the shape {said(found)}, not that of its state, {said(state)}")

    def __call__(self, observations: Array, states: Sequence[Array] = ()) -> tuple[Array, tuple[Array, ...]]:
        """Compute actions; see `ActionNetwork`.

        Raises:
            OnnxError: The library cannot compute them.
        """
        given = (observations, *states)
        results = np.empty((len(observations), self.actions)), *(np.empty(each.shape) for each in states)
        for row in range(len(observations)):
            found = self._row([each.take([row], axis) for each, axis in zip(given, self._axes, strict=True)])
            for result, axis, each in zip(results, self._axes, found, strict=True):
                np.moveaxis(result, axis, 0)[row] = np.moveaxis(each, axis, 0)[0]
        return results[0], results[1:]

    def _row(self, given: Sequence[Array]) -> list[NDArray[Any]]:
        """Compute one row: the action and the next states."""
        feed = {
            name: np.ascontiguousarray(each, dtype)
            for name, each, dtype in zip(self._inputs, given, self._types, strict=True)
        }
        try:
            found = self._session.run(self._outputs, feed)
        except Exception as error:  # as above
            raise _refused(error) from error
        for place, (name, each) in enumerate(zip(self._outputs, found, strict=True)):
            if not isinstance(each, np.ndarray) or each.dtype not in (np.float32, np.float64):
                raise OnnxError(f"its output `{name}` consists of {getattr(each, 'dtype', 'no numbers')}")
            if self._shapes and each.shape != self._shapes[place]:
                raise OnnxError(
                    f"its output `{name}` has the shape {said(each.shape)}, not {said(self._shapes[place])}"
                )
        return list(found)


@lru_cache(maxsize=8)
def _network(content: bytes) -> RuntimeNetwork:
    return RuntimeNetwork(parse(content), content)


def _session(content: bytes) -> Any:
    """Return the library's session for a file, which it gets as bytes, so that it has no folder with further files."""
    runtime = _library()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = SETTINGS["intra_op_num_threads"]
    options.inter_op_num_threads = SETTINGS["inter_op_num_threads"]
    options.execution_mode = getattr(runtime.ExecutionMode, str(SETTINGS["execution_mode"]))
    options.graph_optimization_level = getattr(
        runtime.GraphOptimizationLevel, str(SETTINGS["graph_optimization_level"])
    )
    options.log_severity_level = 4  # its errors are exceptions
    options.add_session_config_entry("session.load_model_format", "ONNX")
    options.add_session_config_entry("session.use_env_allocators", "1")
    return runtime.InferenceSession(content, options, providers=[SETTINGS["provider"]])


@lru_cache(maxsize=1)
def _library() -> Any:
    """Import the library, and limit the memory of sessions that ask for it; sessions of others have their own.

    Raises:
        OnnxError: It is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        said = "`runtime: onnxruntime` needs the module `onnxruntime`: pip install 'symaware-cli[onnx]'"
        raise OnnxError(said) from error
    onnxruntime.set_default_logger_severity(4)  # overflows of sizes are written to it, and raised as well
    memory = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    # 1: as much as is asked for, not the next power of 2.
    limits = onnxruntime.OrtArenaCfg({"max_mem": SETTINGS["memory"], "arena_extend_strategy": 1})
    onnxruntime.create_and_register_allocator(memory, limits)
    return onnxruntime


def _refused(error: Exception) -> OnnxError:
    """Return the error to raise for one of the library."""
    if isinstance(error, OnnxError):
        return error
    text = " ".join(_PREFIX.sub("", str(error)).split())
    return OnnxError(f"onnxruntime does not compute it: {text[:300]}")
