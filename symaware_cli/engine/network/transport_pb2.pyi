from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Frame(_message.Message):
    __slots__ = ("hello", "welcome", "refusal", "step", "report", "notice", "end")
    HELLO_FIELD_NUMBER: _ClassVar[int]
    WELCOME_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    REPORT_FIELD_NUMBER: _ClassVar[int]
    NOTICE_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    hello: Hello
    welcome: Welcome
    refusal: Refusal
    step: Step
    report: Report
    notice: Notice
    end: End
    def __init__(self, hello: _Optional[_Union[Hello, _Mapping]] = ..., welcome: _Optional[_Union[Welcome, _Mapping]] = ..., refusal: _Optional[_Union[Refusal, _Mapping]] = ..., step: _Optional[_Union[Step, _Mapping]] = ..., report: _Optional[_Union[Report, _Mapping]] = ..., notice: _Optional[_Union[Notice, _Mapping]] = ..., end: _Optional[_Union[End, _Mapping]] = ...) -> None: ...

class Hello(_message.Message):
    __slots__ = ("name", "scenario", "version", "agents", "checkpoint")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    AGENTS_FIELD_NUMBER: _ClassVar[int]
    CHECKPOINT_FIELD_NUMBER: _ClassVar[int]
    name: str
    scenario: bytes
    version: str
    agents: _containers.RepeatedScalarFieldContainer[str]
    checkpoint: Checkpoint
    def __init__(self, name: _Optional[str] = ..., scenario: _Optional[bytes] = ..., version: _Optional[str] = ..., agents: _Optional[_Iterable[str]] = ..., checkpoint: _Optional[_Union[Checkpoint, _Mapping]] = ...) -> None: ...

class Checkpoint(_message.Message):
    __slots__ = ("run", "step")
    RUN_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    run: bytes
    step: int
    def __init__(self, run: _Optional[bytes] = ..., step: _Optional[int] = ...) -> None: ...

class Welcome(_message.Message):
    __slots__ = ("step", "time", "pace", "started", "run", "restores", "absent")
    STEP_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    PACE_FIELD_NUMBER: _ClassVar[int]
    STARTED_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    RESTORES_FIELD_NUMBER: _ClassVar[int]
    ABSENT_FIELD_NUMBER: _ClassVar[int]
    step: int
    time: int
    pace: float
    started: float
    run: bytes
    restores: bool
    absent: int
    def __init__(self, step: _Optional[int] = ..., time: _Optional[int] = ..., pace: _Optional[float] = ..., started: _Optional[float] = ..., run: _Optional[bytes] = ..., restores: _Optional[bool] = ..., absent: _Optional[int] = ...) -> None: ...

class Refusal(_message.Message):
    __slots__ = ("reason", "final")
    REASON_FIELD_NUMBER: _ClassVar[int]
    FINAL_FIELD_NUMBER: _ClassVar[int]
    reason: str
    final: bool
    def __init__(self, reason: _Optional[str] = ..., final: _Optional[bool] = ...) -> None: ...

class Step(_message.Message):
    __slots__ = ("step", "time", "world", "contacts", "batches", "deliveries", "started")
    STEP_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    WORLD_FIELD_NUMBER: _ClassVar[int]
    CONTACTS_FIELD_NUMBER: _ClassVar[int]
    BATCHES_FIELD_NUMBER: _ClassVar[int]
    DELIVERIES_FIELD_NUMBER: _ClassVar[int]
    STARTED_FIELD_NUMBER: _ClassVar[int]
    step: int
    time: int
    world: _containers.RepeatedScalarFieldContainer[bytes]
    contacts: _containers.RepeatedScalarFieldContainer[bytes]
    batches: _containers.RepeatedScalarFieldContainer[bytes]
    deliveries: _containers.RepeatedScalarFieldContainer[bytes]
    started: float
    def __init__(self, step: _Optional[int] = ..., time: _Optional[int] = ..., world: _Optional[_Iterable[bytes]] = ..., contacts: _Optional[_Iterable[bytes]] = ..., batches: _Optional[_Iterable[bytes]] = ..., deliveries: _Optional[_Iterable[bytes]] = ..., started: _Optional[float] = ...) -> None: ...

class Report(_message.Message):
    __slots__ = ("step", "inputs", "posts", "peak", "checkpoint")
    STEP_FIELD_NUMBER: _ClassVar[int]
    INPUTS_FIELD_NUMBER: _ClassVar[int]
    POSTS_FIELD_NUMBER: _ClassVar[int]
    PEAK_FIELD_NUMBER: _ClassVar[int]
    CHECKPOINT_FIELD_NUMBER: _ClassVar[int]
    step: int
    inputs: _containers.RepeatedScalarFieldContainer[bytes]
    posts: _containers.RepeatedScalarFieldContainer[bytes]
    peak: Peak
    checkpoint: int
    def __init__(self, step: _Optional[int] = ..., inputs: _Optional[_Iterable[bytes]] = ..., posts: _Optional[_Iterable[bytes]] = ..., peak: _Optional[_Union[Peak, _Mapping]] = ..., checkpoint: _Optional[int] = ...) -> None: ...

class Peak(_message.Message):
    __slots__ = ("risk", "agent")
    RISK_FIELD_NUMBER: _ClassVar[int]
    AGENT_FIELD_NUMBER: _ClassVar[int]
    risk: float
    agent: str
    def __init__(self, risk: _Optional[float] = ..., agent: _Optional[str] = ...) -> None: ...

class Notice(_message.Message):
    __slots__ = ("name", "source", "level", "text", "data")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    name: str
    source: str
    level: str
    text: str
    data: _containers.RepeatedScalarFieldContainer[bytes]
    def __init__(self, name: _Optional[str] = ..., source: _Optional[str] = ..., level: _Optional[str] = ..., text: _Optional[str] = ..., data: _Optional[_Iterable[bytes]] = ...) -> None: ...

class End(_message.Message):
    __slots__ = ("status", "reason", "source")
    STATUS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    status: str
    reason: str
    source: str
    def __init__(self, status: _Optional[str] = ..., reason: _Optional[str] = ..., source: _Optional[str] = ...) -> None: ...

class Contact(_message.Message):
    __slots__ = ("first", "second", "point", "depth", "begins", "impulse")
    FIRST_FIELD_NUMBER: _ClassVar[int]
    SECOND_FIELD_NUMBER: _ClassVar[int]
    POINT_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    BEGINS_FIELD_NUMBER: _ClassVar[int]
    IMPULSE_FIELD_NUMBER: _ClassVar[int]
    first: str
    second: str
    point: _containers.RepeatedScalarFieldContainer[float]
    depth: float
    begins: bool
    impulse: float
    def __init__(self, first: _Optional[str] = ..., second: _Optional[str] = ..., point: _Optional[_Iterable[float]] = ..., depth: _Optional[float] = ..., begins: _Optional[bool] = ..., impulse: _Optional[float] = ...) -> None: ...

class MessageBatch(_message.Message):
    __slots__ = ("senders", "columns", "kind", "receivers")
    SENDERS_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    RECEIVERS_FIELD_NUMBER: _ClassVar[int]
    senders: Array
    columns: _containers.RepeatedScalarFieldContainer[bytes]
    kind: str
    receivers: Array
    def __init__(self, senders: _Optional[_Union[Array, _Mapping]] = ..., columns: _Optional[_Iterable[bytes]] = ..., kind: _Optional[str] = ..., receivers: _Optional[_Union[Array, _Mapping]] = ...) -> None: ...

class Delivery(_message.Message):
    __slots__ = ("batch", "rows", "receivers", "sequences", "sent_time", "due")
    BATCH_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    RECEIVERS_FIELD_NUMBER: _ClassVar[int]
    SEQUENCES_FIELD_NUMBER: _ClassVar[int]
    SENT_TIME_FIELD_NUMBER: _ClassVar[int]
    DUE_FIELD_NUMBER: _ClassVar[int]
    batch: int
    rows: Array
    receivers: Array
    sequences: Array
    sent_time: int
    due: Array
    def __init__(self, batch: _Optional[int] = ..., rows: _Optional[_Union[Array, _Mapping]] = ..., receivers: _Optional[_Union[Array, _Mapping]] = ..., sequences: _Optional[_Union[Array, _Mapping]] = ..., sent_time: _Optional[int] = ..., due: _Optional[_Union[Array, _Mapping]] = ...) -> None: ...

class Post(_message.Message):
    __slots__ = ("batch", "time")
    BATCH_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    batch: MessageBatch
    time: int
    def __init__(self, batch: _Optional[_Union[MessageBatch, _Mapping]] = ..., time: _Optional[int] = ...) -> None: ...

class Input(_message.Message):
    __slots__ = ("group", "rows", "inputs")
    GROUP_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    INPUTS_FIELD_NUMBER: _ClassVar[int]
    group: str
    rows: Array
    inputs: Array
    def __init__(self, group: _Optional[str] = ..., rows: _Optional[_Union[Array, _Mapping]] = ..., inputs: _Optional[_Union[Array, _Mapping]] = ...) -> None: ...

class Entry(_message.Message):
    __slots__ = ("name", "value")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    name: str
    value: Value
    def __init__(self, name: _Optional[str] = ..., value: _Optional[_Union[Value, _Mapping]] = ...) -> None: ...

class Value(_message.Message):
    __slots__ = ("nothing", "truth", "whole", "large", "number", "text", "raw", "array", "scalar", "list", "tuple", "mapping", "series", "awareness")
    NOTHING_FIELD_NUMBER: _ClassVar[int]
    TRUTH_FIELD_NUMBER: _ClassVar[int]
    WHOLE_FIELD_NUMBER: _ClassVar[int]
    LARGE_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    RAW_FIELD_NUMBER: _ClassVar[int]
    ARRAY_FIELD_NUMBER: _ClassVar[int]
    SCALAR_FIELD_NUMBER: _ClassVar[int]
    LIST_FIELD_NUMBER: _ClassVar[int]
    TUPLE_FIELD_NUMBER: _ClassVar[int]
    MAPPING_FIELD_NUMBER: _ClassVar[int]
    SERIES_FIELD_NUMBER: _ClassVar[int]
    AWARENESS_FIELD_NUMBER: _ClassVar[int]
    nothing: bool
    truth: bool
    whole: int
    large: int
    number: float
    text: str
    raw: bytes
    array: Array
    scalar: Array
    list: Items
    tuple: Items
    mapping: Entries
    series: Series
    awareness: AwarenessVector
    def __init__(self, nothing: _Optional[bool] = ..., truth: _Optional[bool] = ..., whole: _Optional[int] = ..., large: _Optional[int] = ..., number: _Optional[float] = ..., text: _Optional[str] = ..., raw: _Optional[bytes] = ..., array: _Optional[_Union[Array, _Mapping]] = ..., scalar: _Optional[_Union[Array, _Mapping]] = ..., list: _Optional[_Union[Items, _Mapping]] = ..., tuple: _Optional[_Union[Items, _Mapping]] = ..., mapping: _Optional[_Union[Entries, _Mapping]] = ..., series: _Optional[_Union[Series, _Mapping]] = ..., awareness: _Optional[_Union[AwarenessVector, _Mapping]] = ...) -> None: ...

class Items(_message.Message):
    __slots__ = ("values",)
    VALUES_FIELD_NUMBER: _ClassVar[int]
    values: _containers.RepeatedScalarFieldContainer[bytes]
    def __init__(self, values: _Optional[_Iterable[bytes]] = ...) -> None: ...

class Entries(_message.Message):
    __slots__ = ("values",)
    VALUES_FIELD_NUMBER: _ClassVar[int]
    values: _containers.RepeatedScalarFieldContainer[bytes]
    def __init__(self, values: _Optional[_Iterable[bytes]] = ...) -> None: ...

class Array(_message.Message):
    __slots__ = ("type", "shape", "data")
    class Type(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        NONE: _ClassVar[Array.Type]
        BOOL: _ClassVar[Array.Type]
        INT8: _ClassVar[Array.Type]
        INT16: _ClassVar[Array.Type]
        INT32: _ClassVar[Array.Type]
        INT64: _ClassVar[Array.Type]
        UINT8: _ClassVar[Array.Type]
        UINT16: _ClassVar[Array.Type]
        UINT32: _ClassVar[Array.Type]
        UINT64: _ClassVar[Array.Type]
        FLOAT16: _ClassVar[Array.Type]
        FLOAT32: _ClassVar[Array.Type]
        FLOAT64: _ClassVar[Array.Type]
    NONE: Array.Type
    BOOL: Array.Type
    INT8: Array.Type
    INT16: Array.Type
    INT32: Array.Type
    INT64: Array.Type
    UINT8: Array.Type
    UINT16: Array.Type
    UINT32: Array.Type
    UINT64: Array.Type
    FLOAT16: Array.Type
    FLOAT32: Array.Type
    FLOAT64: Array.Type
    TYPE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    type: Array.Type
    shape: _containers.RepeatedScalarFieldContainer[int]
    data: bytes
    def __init__(self, type: _Optional[_Union[Array.Type, str]] = ..., shape: _Optional[_Iterable[int]] = ..., data: _Optional[bytes] = ...) -> None: ...

class Series(_message.Message):
    __slots__ = ("times", "values")
    TIMES_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    times: Array
    values: Array
    def __init__(self, times: _Optional[_Union[Array, _Mapping]] = ..., values: _Optional[_Union[Array, _Mapping]] = ...) -> None: ...

class AwarenessVector(_message.Message):
    __slots__ = ("id", "parts")
    ID_FIELD_NUMBER: _ClassVar[int]
    PARTS_FIELD_NUMBER: _ClassVar[int]
    id: str
    parts: _containers.RepeatedScalarFieldContainer[bytes]
    def __init__(self, id: _Optional[str] = ..., parts: _Optional[_Iterable[bytes]] = ...) -> None: ...
