from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Rows(_message.Message):
    __slots__ = ("columns", "rows", "values")
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    columns: int
    rows: _containers.RepeatedScalarFieldContainer[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, columns: _Optional[int] = ..., rows: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class SeriesRows(_message.Message):
    __slots__ = ("columns", "rows", "lengths", "times", "values")
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    TIMES_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    columns: int
    rows: _containers.RepeatedScalarFieldContainer[int]
    lengths: _containers.RepeatedScalarFieldContainer[int]
    times: _containers.RepeatedScalarFieldContainer[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, columns: _Optional[int] = ..., rows: _Optional[_Iterable[int]] = ..., lengths: _Optional[_Iterable[int]] = ..., times: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class TableRows(_message.Message):
    __slots__ = ("columns", "rows", "lengths", "values")
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    columns: int
    rows: _containers.RepeatedScalarFieldContainer[int]
    lengths: _containers.RepeatedScalarFieldContainer[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, columns: _Optional[int] = ..., rows: _Optional[_Iterable[int]] = ..., lengths: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class Awareness(_message.Message):
    __slots__ = ("world", "rows", "lengths", "entities", "columns", "values", "covariances", "ages", "series")
    WORLD_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    ENTITIES_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    COVARIANCES_FIELD_NUMBER: _ClassVar[int]
    AGES_FIELD_NUMBER: _ClassVar[int]
    SERIES_FIELD_NUMBER: _ClassVar[int]
    world: bool
    rows: _containers.RepeatedScalarFieldContainer[int]
    lengths: _containers.RepeatedScalarFieldContainer[int]
    entities: _containers.RepeatedScalarFieldContainer[int]
    columns: _containers.RepeatedScalarFieldContainer[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    covariances: _containers.RepeatedScalarFieldContainer[float]
    ages: _containers.RepeatedScalarFieldContainer[float]
    series: _containers.RepeatedCompositeFieldContainer[OthersSeries]
    def __init__(self, world: _Optional[bool] = ..., rows: _Optional[_Iterable[int]] = ..., lengths: _Optional[_Iterable[int]] = ..., entities: _Optional[_Iterable[int]] = ..., columns: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[float]] = ..., covariances: _Optional[_Iterable[float]] = ..., ages: _Optional[_Iterable[float]] = ..., series: _Optional[_Iterable[_Union[OthersSeries, _Mapping]]] = ...) -> None: ...

class OthersSeries(_message.Message):
    __slots__ = ("part", "rows", "lengths", "entities", "columns", "points", "times", "values")
    PART_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    ENTITIES_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    TIMES_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    part: str
    rows: _containers.RepeatedScalarFieldContainer[int]
    lengths: _containers.RepeatedScalarFieldContainer[int]
    entities: _containers.RepeatedScalarFieldContainer[int]
    columns: _containers.RepeatedScalarFieldContainer[int]
    points: _containers.RepeatedScalarFieldContainer[int]
    times: _containers.RepeatedScalarFieldContainer[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, part: _Optional[str] = ..., rows: _Optional[_Iterable[int]] = ..., lengths: _Optional[_Iterable[int]] = ..., entities: _Optional[_Iterable[int]] = ..., columns: _Optional[_Iterable[int]] = ..., points: _Optional[_Iterable[int]] = ..., times: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class Knowledge(_message.Message):
    __slots__ = ("rows", "values")
    ROWS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    rows: _containers.RepeatedScalarFieldContainer[int]
    values: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, rows: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[str]] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("name", "source", "level", "text", "data")
    class Level(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        LEVEL_UNSPECIFIED: _ClassVar[Event.Level]
        DEBUG: _ClassVar[Event.Level]
        INFO: _ClassVar[Event.Level]
        WARNING: _ClassVar[Event.Level]
        ERROR: _ClassVar[Event.Level]
    LEVEL_UNSPECIFIED: Event.Level
    DEBUG: Event.Level
    INFO: Event.Level
    WARNING: Event.Level
    ERROR: Event.Level
    NAME_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    name: str
    source: str
    level: Event.Level
    text: str
    data: str
    def __init__(self, name: _Optional[str] = ..., source: _Optional[str] = ..., level: _Optional[_Union[Event.Level, str]] = ..., text: _Optional[str] = ..., data: _Optional[str] = ...) -> None: ...

class Recurring(_message.Message):
    __slots__ = ("names", "sources", "name", "source")
    NAMES_FIELD_NUMBER: _ClassVar[int]
    SOURCES_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    names: _containers.RepeatedScalarFieldContainer[str]
    sources: _containers.RepeatedScalarFieldContainer[str]
    name: _containers.RepeatedScalarFieldContainer[int]
    source: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, names: _Optional[_Iterable[str]] = ..., sources: _Optional[_Iterable[str]] = ..., name: _Optional[_Iterable[int]] = ..., source: _Optional[_Iterable[int]] = ...) -> None: ...

class Message(_message.Message):
    __slots__ = ("id", "sender", "receiver", "kind", "stage", "sent_time", "reason", "payload", "size")
    class Stage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STAGE_UNSPECIFIED: _ClassVar[Message.Stage]
        SENT: _ClassVar[Message.Stage]
        DELIVERED: _ClassVar[Message.Stage]
        DROPPED: _ClassVar[Message.Stage]
    STAGE_UNSPECIFIED: Message.Stage
    SENT: Message.Stage
    DELIVERED: Message.Stage
    DROPPED: Message.Stage
    ID_FIELD_NUMBER: _ClassVar[int]
    SENDER_FIELD_NUMBER: _ClassVar[int]
    RECEIVER_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    STAGE_FIELD_NUMBER: _ClassVar[int]
    SENT_TIME_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    PAYLOAD_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    id: int
    sender: str
    receiver: str
    kind: str
    stage: Message.Stage
    sent_time: int
    reason: str
    payload: str
    size: int
    def __init__(self, id: _Optional[int] = ..., sender: _Optional[str] = ..., receiver: _Optional[str] = ..., kind: _Optional[str] = ..., stage: _Optional[_Union[Message.Stage, str]] = ..., sent_time: _Optional[int] = ..., reason: _Optional[str] = ..., payload: _Optional[str] = ..., size: _Optional[int] = ...) -> None: ...

class MessageColumns(_message.Message):
    __slots__ = ("stage", "kind", "sent_time", "size", "senders", "receivers", "sequences", "reasons", "reason", "says", "said", "sizes", "rows")
    class Said(_message.Message):
        __slots__ = ("name", "shape", "values", "texts")
        NAME_FIELD_NUMBER: _ClassVar[int]
        SHAPE_FIELD_NUMBER: _ClassVar[int]
        VALUES_FIELD_NUMBER: _ClassVar[int]
        TEXTS_FIELD_NUMBER: _ClassVar[int]
        name: str
        shape: _containers.RepeatedScalarFieldContainer[int]
        values: _containers.RepeatedScalarFieldContainer[float]
        texts: _containers.RepeatedScalarFieldContainer[str]
        def __init__(self, name: _Optional[str] = ..., shape: _Optional[_Iterable[int]] = ..., values: _Optional[_Iterable[float]] = ..., texts: _Optional[_Iterable[str]] = ...) -> None: ...
    STAGE_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    SENT_TIME_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    SENDERS_FIELD_NUMBER: _ClassVar[int]
    RECEIVERS_FIELD_NUMBER: _ClassVar[int]
    SEQUENCES_FIELD_NUMBER: _ClassVar[int]
    REASONS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    SAYS_FIELD_NUMBER: _ClassVar[int]
    SAID_FIELD_NUMBER: _ClassVar[int]
    SIZES_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    stage: Message.Stage
    kind: str
    sent_time: int
    size: int
    senders: _containers.RepeatedScalarFieldContainer[int]
    receivers: _containers.RepeatedScalarFieldContainer[int]
    sequences: _containers.RepeatedScalarFieldContainer[int]
    reasons: _containers.RepeatedScalarFieldContainer[str]
    reason: _containers.RepeatedScalarFieldContainer[int]
    says: _containers.RepeatedScalarFieldContainer[int]
    said: _containers.RepeatedCompositeFieldContainer[MessageColumns.Said]
    sizes: _containers.RepeatedScalarFieldContainer[int]
    rows: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, stage: _Optional[_Union[Message.Stage, str]] = ..., kind: _Optional[str] = ..., sent_time: _Optional[int] = ..., size: _Optional[int] = ..., senders: _Optional[_Iterable[int]] = ..., receivers: _Optional[_Iterable[int]] = ..., sequences: _Optional[_Iterable[int]] = ..., reasons: _Optional[_Iterable[str]] = ..., reason: _Optional[_Iterable[int]] = ..., says: _Optional[_Iterable[int]] = ..., said: _Optional[_Iterable[_Union[MessageColumns.Said, _Mapping]]] = ..., sizes: _Optional[_Iterable[int]] = ..., rows: _Optional[_Iterable[int]] = ...) -> None: ...

class Scan(_message.Message):
    __slots__ = ("rows", "measured", "range", "angles", "distances", "poses")
    ROWS_FIELD_NUMBER: _ClassVar[int]
    MEASURED_FIELD_NUMBER: _ClassVar[int]
    RANGE_FIELD_NUMBER: _ClassVar[int]
    ANGLES_FIELD_NUMBER: _ClassVar[int]
    DISTANCES_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    rows: _containers.RepeatedScalarFieldContainer[int]
    measured: int
    range: float
    angles: _containers.RepeatedScalarFieldContainer[float]
    distances: _containers.RepeatedScalarFieldContainer[float]
    poses: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, rows: _Optional[_Iterable[int]] = ..., measured: _Optional[int] = ..., range: _Optional[float] = ..., angles: _Optional[_Iterable[float]] = ..., distances: _Optional[_Iterable[float]] = ..., poses: _Optional[_Iterable[float]] = ...) -> None: ...

class Image(_message.Message):
    __slots__ = ("row", "measured", "kind", "data", "field_of_view", "position", "target")
    class Kind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        KIND_UNSPECIFIED: _ClassVar[Image.Kind]
        COLOUR: _ClassVar[Image.Kind]
        DEPTH: _ClassVar[Image.Kind]
        SEGMENTS: _ClassVar[Image.Kind]
    KIND_UNSPECIFIED: Image.Kind
    COLOUR: Image.Kind
    DEPTH: Image.Kind
    SEGMENTS: Image.Kind
    ROW_FIELD_NUMBER: _ClassVar[int]
    MEASURED_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    FIELD_OF_VIEW_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    row: int
    measured: int
    kind: Image.Kind
    data: bytes
    field_of_view: float
    position: _containers.RepeatedScalarFieldContainer[float]
    target: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, row: _Optional[int] = ..., measured: _Optional[int] = ..., kind: _Optional[_Union[Image.Kind, str]] = ..., data: _Optional[bytes] = ..., field_of_view: _Optional[float] = ..., position: _Optional[_Iterable[float]] = ..., target: _Optional[_Iterable[float]] = ...) -> None: ...

class Contact(_message.Message):
    __slots__ = ("a", "b", "point", "depth", "stage", "impulse")
    class Stage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STAGE_UNSPECIFIED: _ClassVar[Contact.Stage]
        BEGIN: _ClassVar[Contact.Stage]
        END: _ClassVar[Contact.Stage]
        RESUME: _ClassVar[Contact.Stage]
    STAGE_UNSPECIFIED: Contact.Stage
    BEGIN: Contact.Stage
    END: Contact.Stage
    RESUME: Contact.Stage
    A_FIELD_NUMBER: _ClassVar[int]
    B_FIELD_NUMBER: _ClassVar[int]
    POINT_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    STAGE_FIELD_NUMBER: _ClassVar[int]
    IMPULSE_FIELD_NUMBER: _ClassVar[int]
    a: str
    b: str
    point: _containers.RepeatedScalarFieldContainer[float]
    depth: float
    stage: Contact.Stage
    impulse: float
    def __init__(self, a: _Optional[str] = ..., b: _Optional[str] = ..., point: _Optional[_Iterable[float]] = ..., depth: _Optional[float] = ..., stage: _Optional[_Union[Contact.Stage, str]] = ..., impulse: _Optional[float] = ...) -> None: ...

class Timing(_message.Message):
    __slots__ = ("wall_time", "cpu_time", "steps", "pace", "instants", "late", "worst_lateness")
    WALL_TIME_FIELD_NUMBER: _ClassVar[int]
    CPU_TIME_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    PACE_FIELD_NUMBER: _ClassVar[int]
    INSTANTS_FIELD_NUMBER: _ClassVar[int]
    LATE_FIELD_NUMBER: _ClassVar[int]
    WORST_LATENESS_FIELD_NUMBER: _ClassVar[int]
    wall_time: float
    cpu_time: float
    steps: int
    pace: float
    instants: int
    late: int
    worst_lateness: float
    def __init__(self, wall_time: _Optional[float] = ..., cpu_time: _Optional[float] = ..., steps: _Optional[int] = ..., pace: _Optional[float] = ..., instants: _Optional[int] = ..., late: _Optional[int] = ..., worst_lateness: _Optional[float] = ...) -> None: ...

class Specification(_message.Message):
    __slots__ = ("rows", "verdicts", "lower", "upper", "times", "exact_rows", "robustness", "settled")
    ROWS_FIELD_NUMBER: _ClassVar[int]
    VERDICTS_FIELD_NUMBER: _ClassVar[int]
    LOWER_FIELD_NUMBER: _ClassVar[int]
    UPPER_FIELD_NUMBER: _ClassVar[int]
    TIMES_FIELD_NUMBER: _ClassVar[int]
    EXACT_ROWS_FIELD_NUMBER: _ClassVar[int]
    ROBUSTNESS_FIELD_NUMBER: _ClassVar[int]
    SETTLED_FIELD_NUMBER: _ClassVar[int]
    rows: _containers.RepeatedScalarFieldContainer[int]
    verdicts: bytes
    lower: _containers.RepeatedScalarFieldContainer[float]
    upper: _containers.RepeatedScalarFieldContainer[float]
    times: _containers.RepeatedScalarFieldContainer[int]
    exact_rows: _containers.RepeatedScalarFieldContainer[int]
    robustness: _containers.RepeatedScalarFieldContainer[float]
    settled: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, rows: _Optional[_Iterable[int]] = ..., verdicts: _Optional[bytes] = ..., lower: _Optional[_Iterable[float]] = ..., upper: _Optional[_Iterable[float]] = ..., times: _Optional[_Iterable[int]] = ..., exact_rows: _Optional[_Iterable[int]] = ..., robustness: _Optional[_Iterable[float]] = ..., settled: _Optional[_Iterable[float]] = ...) -> None: ...
