"""Records are what frozen data classes with slots are."""

import copy
import inspect
import pickle
from collections.abc import Callable
from dataclasses import KW_ONLY, FrozenInstanceError, asdict, dataclass, field, fields, replace
from typing import Any

import pytest

from symaware_cli.world import is_record, record


@record
class Place:
    """A place.

    Attributes:
        x: [m].
        y: [m].
        names: What it is called.
        note: Neither compared nor shown.
    """

    x: float
    y: float = 0.0
    names: list[str] = field(default_factory=list)
    note: str = field(default="", repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.x < 0.0:
            raise ValueError("negative")
        object.__setattr__(self, "y", float(self.y))


@record
class Tower(Place):
    """A place with a height [m]."""

    _: KW_ONLY
    height: float


@record
class Point:
    """Values that can be hashed."""

    x: float
    y: float = 0.0


@dataclass(frozen=True, slots=True)
class Standard:
    """The same values in a data class of the standard library."""

    x: float
    y: float = 0.0


def named(value: object) -> str:
    return str(value).replace("Standard", "Point")


@pytest.mark.parametrize(
    "use",
    [
        repr,
        hash,
        asdict,
        lambda point: [(each.name, each.type) for each in fields(point)],
        lambda point: point == type(point)(1.0, 2.0),
        lambda point: point != type(point)(1.0, 3.0),
        lambda point: point == (1.0, 2.0),
        lambda point: replace(point, y=5.0),
        lambda point: inspect.signature(type(point)),
        lambda point: type(point).__match_args__,
        lambda point: type(point).__slots__,
        lambda point: hasattr(point, "__dict__"),
    ],
)
def test_a_record_is_what_a_frozen_data_class_is(use: Callable[[Any], object]) -> None:
    assert named(use(Point(1.0, 2.0))) == named(use(Standard(1.0, 2.0)))


def test_a_record_cannot_be_changed() -> None:
    point: Any = Point(1.0)
    for name in ("x", "other"):
        with pytest.raises(FrozenInstanceError):
            setattr(point, name, 2.0)
        with pytest.raises(FrozenInstanceError):
            delattr(point, name)
    assert point == Point(1.0)


def test_records_of_different_classes_differ() -> None:
    standard: Any = Standard(1.0)
    assert Point(1.0) != standard
    assert Place(1.0) != Tower(1.0, height=2.0)


def test_each_record_gets_its_own_default_from_a_factory() -> None:
    one, other = Place(1.0), Place(1.0)
    one.names.append("here")
    assert (one.names, other.names) == (["here"], [])


def test_fields_can_be_left_out_of_comparison_and_text() -> None:
    assert Place(1.0, note="a") == Place(1.0, note="b")
    assert repr(Place(1.0, note="a")) == "Place(x=1.0, y=0.0, names=[])"


def test_what_follows_the_fields_is_called_after_them() -> None:
    assert type(Place(1.0, 2).y) is float
    with pytest.raises(ValueError, match="negative"):
        Place(-1.0)
    with pytest.raises(ValueError, match="negative"):
        Tower(-1.0, height=1.0)


def test_a_record_inherits_fields_and_may_take_further_ones_by_keyword_alone() -> None:
    tower = Tower(1.0, 2.0, ["here"], height=3.0)
    assert repr(tower) == "Tower(x=1.0, y=2.0, names=['here'], height=3.0)"
    with pytest.raises(TypeError):
        Tower(1.0, 2.0, ["here"], "", 3.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="height"):
        Tower(1.0)  # type: ignore[call-arg]


def test_records_are_copied_and_pickled() -> None:
    tower = Tower(1.0, 2.0, ["here"], "note", height=3.0)
    for other in (copy.copy(tower), copy.deepcopy(tower), pickle.loads(pickle.dumps(tower))):
        assert other == tower
        assert other.note == "note"
    assert copy.deepcopy(tower).names is not tower.names


def test_a_class_is_known_to_be_a_record() -> None:
    assert [is_record(kind) for kind in (Place, Tower, Point, Standard, int)] == [True, True, True, False, False]
