"""Files of networks in the format ONNX: bounded reading of the part that policies need, and writing.

The numbers of fields are those of the specification, https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.protobuf_fields import (
    BYTES,
    FIXED32,
    FIXED64,
    FieldError,
    FieldReader,
    WireField,
    content_of,
    float_of,
    integer_of,
    integers_of,
    text_of,
)

Array = NDArray[np.float64]

#: The greatest size of a file in bytes, the most fields of all its messages, the most nodes, and the most dimensions.
LARGEST, _MOST_FIELDS, _MOST_NODES, _MOST_DIMENSIONS = 2**24, 200_000, 10_000, 8

#: Types of elements, by their numbers in the format: those that can be read, and names of others for messages.
_TYPES: Mapping[int, np.dtype[Any]] = {
    1: np.dtype("<f4"),
    6: np.dtype("<i4"),
    7: np.dtype("<i8"),
    9: np.dtype("?"),
    11: np.dtype("<f8"),
}
_NAMES = {
    2: "uint8",
    3: "int8",
    4: "uint16",
    5: "int16",
    8: "string",
    10: "float16",
    12: "uint32",
    13: "uint64",
    14: "complex64",
    15: "complex128",
    16: "bfloat16",
}
FLOAT, DOUBLE = 1, 11

#: The fields of a tensor that contain elements, by type.
_ELEMENTS = {1: 4, 6: 5, 7: 7, 9: 5, 11: 10}


class OnnxError(ValueError):
    """A file is no ONNX file, or contains an unsupported feature; the message names the feature and its place."""


class UnsupportedOperatorError(OnnxError):
    """A file has an operator without a kernel of this package; another runtime may compute it."""


class OnnxValue(NamedTuple):
    """An input or output of a graph.

    Attributes:
        name: The name of the value.
        shape: The dimensions: a number, or the name, possibly empty, of a dimension that is not fixed. None if the file
            does not specify a shape.
    """

    name: str
    shape: tuple[int | str, ...] | None


class OnnxNode(NamedTuple):
    """An operator of a graph.

    Attributes:
        label: The operator and its name or number, for messages.
        operator: The operator, such as ``Gemm``.
        inputs: The names of its inputs; empty where an optional input is left out.
        outputs: The names of its outputs.
        attributes: Numbers, texts, and lists or arrays of numbers, by name.
    """

    label: str
    operator: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, Attribute]


#: The value of an attribute.
Attribute = float | int | str | list[float] | list[int] | NDArray[np.float64] | NDArray[np.int64]


class OnnxGraph(NamedTuple):
    """A network as written in the file.

    Attributes:
        opset: The version of the operators.
        constants: Arrays by name: float64, or int64 for axes and shapes.
        inputs: Its inputs, without constants.
        outputs: Its outputs.
        nodes: Its operators.
        has_functions: Whether the file also defines functions, or a graph for training, neither of which is read.
    """

    opset: int
    constants: Mapping[str, NDArray[np.float64] | NDArray[np.int64]]
    inputs: tuple[OnnxValue, ...]
    outputs: tuple[OnnxValue, ...]
    nodes: tuple[OnnxNode, ...]
    has_functions: bool = False


def read_bounded(path: Path, name: str) -> bytes:
    """Read a file of at most `LARGEST` bytes.

    Args:
        path: The file.
        name: The name of the file, for messages.

    Raises:
        OnnxError: The file cannot be read, is larger, or has the suffix of another format.
    """
    suffix = path.suffix.lower()
    if suffix in (".pt", ".pth", ".pkl", ".pickle", ".zip"):
        raise OnnxError(
            f"{name} may contain code, as all files of the formats of Python's pickle, and is not opened: export the "
            "network as ONNX, for instance by `torch.onnx.export`"
        )
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
    except OSError as error:
        raise OnnxError(f"{name} cannot be read: {error.strerror}") from error
    if len(content) > LARGEST:
        raise OnnxError(f"{name} is larger than {LARGEST:,} bytes")
    return content


def parse(content: bytes) -> OnnxGraph:
    """Read the content of a file.

    Raises:
        OnnxError: The file is damaged, or contains an unsupported feature.
    """
    try:
        return _Reader(content).model()
    except FieldError as error:
        raise OnnxError(f"it is no ONNX file, or damaged: {error}") from error


class _Reader:
    def __init__(self, content: bytes) -> None:
        self._reader = FieldReader(content, _MOST_FIELDS)

    def model(self) -> OnnxGraph:
        graphs, opset, domains, is_model, has_functions = [], 0, [], False, False
        for field in self._reader.fields(self._reader.whole):
            match field.number:
                case 1:
                    is_model = 1 <= integer_of(field) <= 1000
                case 7:
                    graphs.append(field)
                case 8:
                    domain, version = self._opset(field)
                    if domain in ("", "ai.onnx"):
                        opset = version
                    else:
                        domains.append(domain)
                case 20 | 25:
                    has_functions = True
        if not is_model or len(graphs) != 1:
            raise OnnxError("it is no ONNX file: it has no version of the format, or not one graph")
        if not 11 <= opset <= 30:
            said = f"version {opset}" if opset else "no version"
            raise OnnxError(f"its operators have {said}, and those of versions 11 to 30 are supported")
        return self._graph(graphs[0], opset)._replace(has_functions=has_functions)

    def _opset(self, field: WireField) -> tuple[str, int]:
        domain, version = "", 0
        for each in self._reader.fields(field):
            if each.number == 1:
                domain = text_of(each)
            elif each.number == 2:
                version = integer_of(each)
        return domain, version

    def _graph(self, field: WireField, opset: int) -> OnnxGraph:
        constants: dict[str, NDArray[np.float64] | NDArray[np.int64]] = {}
        nodes: list[OnnxNode] = []
        inputs: list[OnnxValue] = []
        outputs: list[OnnxValue] = []
        for each in self._reader.fields(field):
            match each.number:
                case 1:
                    if len(nodes) == _MOST_NODES:
                        raise OnnxError(f"it has more than {_MOST_NODES:,} operators")
                    nodes.append(self._node(each, len(nodes)))
                case 5:
                    name, values = self._tensor(each)
                    if not name or name in constants:
                        raise OnnxError(f"byte {each.start}: two constants have the name `{name}`, or one has none")
                    constants[name] = values
                case 11:
                    inputs.append(self._value(each))
                case 12:
                    outputs.append(self._value(each))
                case 15:
                    raise OnnxError(f"byte {each.start}: sparse constants are not supported")
        # Older files list constants among the inputs.
        free = tuple(each for each in inputs if each.name not in constants)
        return OnnxGraph(opset, constants, free, tuple(outputs), tuple(nodes))

    def _node(self, field: WireField, number: int) -> OnnxNode:
        texts: dict[int, list[str]] = {1: [], 2: [], 3: [], 4: [], 7: []}
        written = []
        for each in self._reader.fields(field):
            if each.number in texts:
                texts[each.number].append(text_of(each))
            elif each.number == 5:
                written.append(each)
        operator, domain = "".join(texts[4]), "".join(texts[7])
        name = "".join(texts[3])
        label = f"{operator or 'operator'} `{name}`" if name else f"{operator or 'operator'} (number {number})"
        if domain not in ("", "ai.onnx"):
            raise OnnxError(f"{label} is one of `{domain}`, and only operators of ONNX itself are supported")
        attributes: dict[str, Attribute] = {}
        for each in written:
            key, value = self._attribute(each, label)
            if key in attributes:
                raise OnnxError(f"{label} has the attribute `{key}` twice")
            attributes[key] = value
        return OnnxNode(label, operator, tuple(texts[1]), tuple(texts[2]), attributes)

    def _attribute(self, field: WireField, label: str) -> tuple[str, Attribute]:
        name, kind, values = "", 0, list[WireField]()
        for each in self._reader.fields(field):
            if each.number == 1:
                name = text_of(each)
            elif each.number == 20:
                kind = integer_of(each)
            elif each.number == 21:
                raise OnnxError(f"{label}: the attribute `{name}` refers to that of a function, which is not supported")
            elif each.number not in (13,):
                values.append(each)
        # The number of each type of attribute, and the number of the field with its value.
        number = {1: 2, 2: 3, 3: 4, 4: 5, 6: 7, 7: 8}.get(kind)
        if kind == 8:  # texts, used only for the names of activations
            return name, " ".join(text_of(each) for each in values if each.number == 9)
        if number is None:
            raise OnnxError(f"{label}: the attribute `{name}` has the type {kind}, which is not supported")
        own = [each for each in values if each.number == number]
        if kind in (6, 7):
            if kind == 7:
                return name, [integer for each in own for integer in integers_of(each, 1000)]
            return name, [number for each in own for number in self._floats(each)]
        if len(own) > 1:
            raise OnnxError(f"{label}: the attribute `{name}` has {len(own)} values")
        if not own:  # the format omits zeros
            if kind == 4:
                raise OnnxError(f"{label}: the attribute `{name}` has no value")
            zeros: dict[int, float | int | str] = {1: 0.0, 2: 0, 3: ""}
            return name, zeros[kind]
        match kind:
            case 1:
                return name, float_of(own[0])
            case 2:
                return name, integer_of(own[0])
            case 3:
                return name, text_of(own[0])
            case _:
                return name, self._tensor(own[0])[1]

    @staticmethod
    def _floats(field: WireField) -> list[float]:
        if field.kind == FIXED32:
            return [float_of(field)]
        content = content_of(field)
        if len(content) % 4 or len(content) > 4000:
            raise FieldError(f"byte {field.start}: no list of numbers")
        return [float(each) for each in np.frombuffer(content, "<f4")]

    def _value(self, field: WireField) -> OnnxValue:
        name, shape, kind = "", None, None
        for each in self._reader.fields(field):
            if each.number == 1:
                name = text_of(each)
            elif each.number == 2:
                for inner in self._reader.fields(each):
                    if inner.number == 1:
                        kind, shape = self._type(inner)
        if kind not in (None, FLOAT, DOUBLE):
            raise OnnxError(f"`{name}` consists of {_name_of_type(kind)}, and inputs and outputs are float or double")
        return OnnxValue(name, shape)

    def _type(self, field: WireField) -> tuple[int, tuple[int | str, ...] | None]:
        kind, shape = 0, None
        for each in self._reader.fields(field):
            if each.number == 1:
                kind = integer_of(each)
            elif each.number == 2:
                shape = tuple(self._dimension(dim) for dim in self._reader.fields(each) if dim.number == 1)
        return kind, shape

    def _dimension(self, field: WireField) -> int | str:
        found: int | str = ""
        for each in self._reader.fields(field):
            if each.number == 1:
                found = integer_of(each)
            elif each.number == 2:
                found = text_of(each)
        return found

    def _tensor(self, field: WireField) -> tuple[str, NDArray[np.float64] | NDArray[np.int64]]:
        name, kind, shape = "", 0, list[int]()
        raw: WireField | None = None
        listed: dict[int, list[WireField]] = {}
        for each in self._reader.fields(field):
            match each.number:
                case 1:
                    shape += integers_of(each, _MOST_DIMENSIONS)
                case 2:
                    kind = integer_of(each)
                case 8:
                    name = text_of(each)
                case 9:
                    raw = each
                case 13 | 14 if each.number == 13 or integer_of(each):
                    raise OnnxError(
                        f"the constant `{name}` is in another file, which is not read: save the network as one file"
                    )
                case 4 | 5 | 7 | 10 | 11:
                    listed.setdefault(each.number, []).append(each)
        said = f"the constant `{name}`" if name else f"the constant at byte {field.start}"
        dtype = _TYPES.get(kind)
        if dtype is None:
            raise OnnxError(f"{said} consists of {_name_of_type(kind)}, which is not supported")
        if len(shape) > _MOST_DIMENSIONS or any(each < 1 for each in shape):
            raise OnnxError(f"{said} has the shape {_said(shape)}")
        count = math.prod(shape)
        if raw is not None:
            content = content_of(raw)
            if len(content) != count * dtype.itemsize:
                expected = f"{count * dtype.itemsize} bytes of its shape {_said(shape)}"
                raise OnnxError(f"{said} has {len(content)} bytes, not the {expected}")
            values = np.frombuffer(content, dtype)
        else:
            values = self._listed(listed.get(_ELEMENTS[kind], []), kind, dtype)
            if len(values) != count:
                raise OnnxError(f"{said} has {len(values)} elements, not the {count} of its shape {_said(shape)}")
        if kind not in (FLOAT, DOUBLE):
            return name, values.astype(np.int64).reshape(shape)
        with np.errstate(invalid="ignore"):  # conversion of a signalling NaN warns
            numbers = values.astype(np.float64)
        if not np.isfinite(numbers).all():
            raise OnnxError(f"{said} has an element that is not finite")
        return name, numbers.reshape(shape)

    @staticmethod
    def _listed(fields: Sequence[WireField], kind: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return elements that are written as separate fields, or packed in fields."""
        if kind not in (FLOAT, DOUBLE):
            return np.array([number for each in fields for number in integers_of(each, 1_000_000)], np.int64)
        single, width = (FIXED32, 4) if kind == FLOAT else (FIXED64, 8)
        parts = []
        for each in fields:
            if each.kind == single and isinstance(each.value, int):
                parts.append(each.value.to_bytes(width, "little"))
            elif each.kind == BYTES and not len(content_of(each)) % width:
                parts.append(bytes(content_of(each)))
            else:
                raise FieldError(f"byte {each.start}: no list of numbers")
        return np.frombuffer(b"".join(parts), dtype)


def _name_of_type(kind: int | None) -> str:
    return _NAMES.get(kind or 0, {6: "int32", 7: "int64", 9: "bool"}.get(kind or 0, f"the unknown type {kind}"))


def _said(shape: Sequence[int]) -> str:
    return "(" + ", ".join(map(str, shape[:9])) + ")"
