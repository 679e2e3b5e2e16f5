"""Encoding of message values as protobuf; decoding never runs code nor allocates more memory than the data's length.

Arrays are sent as little-endian bytes, so that the received values are identical to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError, Message
from numpy.typing import NDArray

from symaware_cli.core import PARTS, AwarenessVector, TimeSeries
from symaware_cli.engine.network import transport_pb2 as wire

#: The deepest nesting of mappings and lists.
DEPTH = 16

#: An array without elements could claim any shape; no dimension of it may exceed this.
LONGEST_EMPTY = 2**20

#: The kinds of the built-in parts of awareness vectors.
_KINDS = {part.name: part.kind for part in PARTS}

#: The number of dimensions that every version of NumPy supports.
_DIMENSIONS = 32

_TYPES = {
    wire.Array.BOOL: np.dtype(np.bool_),
    wire.Array.INT8: np.dtype("<i1"),
    wire.Array.INT16: np.dtype("<i2"),
    wire.Array.INT32: np.dtype("<i4"),
    wire.Array.INT64: np.dtype("<i8"),
    wire.Array.UINT8: np.dtype("<u1"),
    wire.Array.UINT16: np.dtype("<u2"),
    wire.Array.UINT32: np.dtype("<u4"),
    wire.Array.UINT64: np.dtype("<u8"),
    wire.Array.FLOAT16: np.dtype("<f2"),
    wire.Array.FLOAT32: np.dtype("<f4"),
    wire.Array.FLOAT64: np.dtype("<f8"),
}
_CODES = {dtype: code for code, dtype in _TYPES.items()}


class FrameError(ValueError):
    """These bytes are no frame, or no value of one."""


def parsed(kind: type[Any], data: bytes) -> Any:
    """Parse a message.

    Raises:
        FrameError: These bytes are no such message.
    """
    try:
        return kind.FromString(data)
    except DecodeError as error:
        raise FrameError(f"these bytes are no {kind.DESCRIPTOR.name}") from error


def present(message: Message, field: str) -> Any:
    """Return a part of a message.

    Raises:
        FrameError: It is missing.
    """
    if not message.HasField(field):
        raise FrameError(f"{message.DESCRIPTOR.name}.{field} is missing")
    return getattr(message, field)


def array_to_wire(array: NDArray[Any]) -> wire.Array:
    """Encode an array.

    Raises:
        TypeError: It does not hold plain numbers, or has a huge shape without elements.
    """
    dtype = array.dtype.newbyteorder("<")
    code = _CODES.get(dtype)
    if code is None:
        raise TypeError(f"an array of {array.dtype} cannot be sent: numbers and truth values only")
    if not array.size and max(array.shape) > LONGEST_EMPTY:
        raise TypeError(f"an array of shape {array.shape} without any number cannot be sent")
    return wire.Array(type=code, shape=array.shape, data=array.astype(dtype, copy=False).tobytes())


def array_from_wire(message: wire.Array, *kinds: str, dimensions: int | None = None) -> NDArray[Any]:
    """Decode an array as a read-only one.

    Args:
        message: The encoded array.
        kinds: The allowed kinds of numbers, as in `numpy.dtype.kind`; any if left out.
        dimensions: The required number of dimensions; any if None.

    Raises:
        FrameError: The data do not fit.
    """
    dtype = _TYPES.get(message.type)
    if dtype is None or (kinds and dtype.kind not in kinds):
        raise FrameError(f"an array of type {message.type} has no place here")
    if len(message.shape) > _DIMENSIONS or dimensions not in (None, len(message.shape)):
        raise FrameError(f"an array of {len(message.shape)} dimensions has no place here")
    shape, data = tuple(message.shape), message.data
    if math.prod(shape) * dtype.itemsize != len(data):
        raise FrameError(f"{len(data)} bytes are no array of shape {shape} of {dtype}")
    if not data and shape and max(shape) > LONGEST_EMPTY:
        raise FrameError(f"an array of shape {shape} without any number has no place here")
    # One object, where `frombuffer` and `reshape` make two.
    array: NDArray[Any] = np.ndarray(shape, dtype, data)
    if dtype.kind == "b" and array.view(np.uint8).max(initial=0) > 1:
        raise FrameError("a truth value is neither 0 nor 1")
    return array


def entries_to_wire(mapping: Mapping[Any, Any], depth: int = 0) -> list[bytes]:
    """Encode values by name.

    Raises:
        TypeError: A name is not a text, or a value cannot be sent.
    """
    entries = []
    for name, value in mapping.items():
        if not isinstance(name, str):
            raise TypeError(f"a mapping with a {_called(name)} as a key cannot be sent: text only")
        entries.append(wire.Entry(name=text_to_wire(name), value=value_to_wire(value, depth)).SerializeToString())
    return entries


def entries_from_wire(entries: Iterable[bytes], depth: int = 0) -> dict[str, Any]:
    """Decode values by name.

    Raises:
        FrameError: The data are invalid, or a name occurs twice.
    """
    mapping: dict[str, Any] = {}
    for data in entries:
        entry = parsed(wire.Entry, data)
        if entry.name in mapping:
            raise FrameError(f"the name {entry.name!r} comes twice")
        mapping[entry.name] = value_from_wire(present(entry, "value"), depth)
    return mapping


def text_to_wire(text: str) -> str:
    """Return a text that can be sent.

    Raises:
        TypeError: It cannot be sent.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise TypeError("a str that is no Unicode text cannot be sent") from error
    return str(text)


def value_to_wire(value: Any, depth: int = 0) -> wire.Value:
    """Encode a value.

    Args:
        value: The value.
        depth: The number of mappings and lists around it.

    Raises:
        TypeError: It cannot be sent.
    """
    if value is None:
        return wire.Value(nothing=True)
    if isinstance(value, np.generic) and value.dtype in _CODES:
        return wire.Value(scalar=array_to_wire(np.asarray(value)))
    if isinstance(value, bool):
        return wire.Value(truth=value)
    if isinstance(value, int):
        return _whole(int(value))
    if isinstance(value, float):
        return wire.Value(number=float(value))
    if isinstance(value, str):
        return wire.Value(text=text_to_wire(value))
    if isinstance(value, bytes):
        return wire.Value(raw=bytes(value))
    if isinstance(value, np.ndarray):
        return wire.Value(array=array_to_wire(value))
    if isinstance(value, TimeSeries):
        return wire.Value(series=wire.Series(times=array_to_wire(value.times), values=array_to_wire(value.values)))
    if isinstance(value, AwarenessVector):
        parts = entries_to_wire(dict(value.items()))
        return wire.Value(awareness=wire.AwarenessVector(id=text_to_wire(value.id), parts=parts))
    if isinstance(value, list | tuple | Mapping):
        return _collection(value, depth)
    raise TypeError(f"a {_called(value)} cannot be sent")


def _whole(value: int) -> wire.Value:
    if -(2**63) <= value < 2**63:
        return wire.Value(whole=value)
    if 0 <= value < 2**64:
        return wire.Value(large=value)
    raise TypeError(f"an int of {value.bit_length()} bits cannot be sent: 64 at most")


def _collection(value: Any, depth: int) -> wire.Value:
    if depth == DEPTH:
        raise TypeError(f"a {_called(value)} within {DEPTH} others cannot be sent")
    if isinstance(value, Mapping):
        return wire.Value(mapping=wire.Entries(values=entries_to_wire(value, depth + 1)))
    items = wire.Items(values=[value_to_wire(each, depth + 1).SerializeToString() for each in value])
    return wire.Value(list=items) if isinstance(value, list) else wire.Value(tuple=items)


def value_from_wire(message: wire.Value, depth: int = 0) -> Any:
    """Decode a value.

    Raises:
        FrameError: The data are invalid.
    """
    kind = message.WhichOneof("kind")
    if kind is None:
        raise FrameError("a value is missing, or of a kind that is not known")
    if depth > DEPTH and kind not in ("array", "series"):
        raise FrameError(f"a part of an awareness vector is a {kind}, neither an array nor a series")
    content = getattr(message, kind)
    if kind == "nothing":
        return None
    if kind == "array":
        return array_from_wire(content)
    if kind == "scalar":
        return array_from_wire(content, dimensions=0)[()]
    if kind == "series":
        return _series_from_wire(content)
    if kind == "awareness":
        return _awareness_from_wire(content)
    if kind in ("list", "tuple", "mapping"):
        if depth == DEPTH:
            raise FrameError(f"something stands within more than {DEPTH} others")
        if kind == "mapping":
            return entries_from_wire(content.values, depth + 1)
        items = [value_from_wire(parsed(wire.Value, data), depth + 1) for data in content.values]
        return items if kind == "list" else tuple(items)
    return content


def _series_from_wire(message: wire.Series) -> TimeSeries:
    times = array_from_wire(present(message, "times"), "i", dimensions=1)
    values = array_from_wire(present(message, "values"), "f", dimensions=2)
    try:
        return TimeSeries.sampled(times, values)
    except ValueError as error:
        raise FrameError(str(error)) from error


def _awareness_from_wire(message: wire.AwarenessVector) -> AwarenessVector:
    parts = entries_from_wire(message.parts, DEPTH + 1)
    if "state" not in parts:
        raise FrameError("AwarenessVector.state is missing")
    for name, value in parts.items():
        is_series = isinstance(value, TimeSeries)
        if not (is_series or value.dtype.kind == "f") or (name in _KINDS and is_series != (_KINDS[name] == "series")):
            raise FrameError(f"the part {name!r} of an awareness vector is of a wrong kind")
    if "id" in parts:
        raise FrameError("an awareness vector has no part `id`")
    return AwarenessVector(message.id, **parts)


def _called(value: Any) -> str:
    kind = type(value)
    return kind.__qualname__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"
