"""Serialising objects into plain entries, and restoring them."""

import enum
import threading
from collections import Counter, OrderedDict, defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import untyped

from symaware_cli.core import TimeSeries
from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.state.counterparts import Counterparts
from symaware_cli.engine.runtime.state.deserialiser import Deserialiser
from symaware_cli.engine.runtime.state.serialiser import Serialiser
from symaware_cli.specification.columns import FUNCTIONS
from symaware_cli.specification.expression import Expression

PACKAGES = {__name__.partition(".")[0], "symaware_cli"}


class Thing:
    """Something with attributes."""

    def __init__(self, **attributes: Any) -> None:
        vars(self).update(attributes)

    def method(self) -> Self:
        return self


class Slotted:
    __slots__ = ("_a", "b")


class Colour(enum.Enum):
    RED = "red"


class Pair(NamedTuple):
    one: int
    other: int


@dataclass(frozen=True)
class Value:
    part: object


def take(thing: Slotted | Thing) -> list[tuple[str, str, list[Any]]]:
    return Serialiser({"thing": thing}, PACKAGES).entries


def put(entries: Sequence[tuple[str, str, list[Any]]], thing: Slotted | Thing) -> None:
    Deserialiser(Counterparts(entries, {"thing": thing}, PACKAGES)).restore()


def moved(**attributes: Any) -> Thing:
    """A thing that got its attributes from another one."""
    thing = Thing()
    put(take(Thing(**attributes)), thing)
    return thing


@pytest.mark.parametrize(
    "value",
    [
        *(None, True, 3, 2**80, -1.5, "text", b"bytes", 1 + 2j, np.float32(0.1), np.int64(3)),
        *([1, [2]], (1, (2, "a")), {"a": 1, 2: (3,), (4, 5): 6}, {3, 1}, frozenset({"a"}), deque([1, 2], maxlen=3)),
        *(Counter("aab"), OrderedDict(b=1, a=2), defaultdict(list, {"a": [1]}), Pair(1, 2), Colour.RED),
        *(Value([1]), range(2, 9, 3), slice(1, None), np.dtype("f4"), int, len),
    ],
    ids=repr,
)
def test_a_value_is_equal_and_of_the_same_type_afterwards(value: bool | None) -> None:
    found = untyped(moved(value=value)).value
    assert type(found) is type(value)
    assert found == value


@pytest.mark.parametrize(
    "array",
    [
        *(np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)), np.zeros((0, 3)), np.array(4)),
        *(np.array(["a", "bc"]), np.array([True, False]), np.zeros(2, [("x", "f8"), ("y", "i4")])),
        np.arange(24).reshape(2, 3, 4).transpose(2, 0, 1).copy(order="K"),
    ],
    ids=repr,
)
@pytest.mark.parametrize("writeable", [True, False])
def test_an_array_has_the_same_bits_layout_and_permission(array: NDArray[np.float64], writeable: bool) -> None:
    array = array.copy(order="K")
    array.flags.writeable = writeable
    found = untyped(moved(array=array)).array
    assert (found.dtype, found.shape, found.strides) == (array.dtype, array.shape, array.strides)
    assert found.tobytes() == array.tobytes()
    assert found.flags.writeable == writeable
    assert found.base is None


def test_an_array_of_another_layout_stays_one_array_for_all_its_holders() -> None:
    array = np.arange(6.0).reshape(2, 3).T.copy(order="F")
    thing: Any = moved(one=array, other=array)
    assert thing.one is thing.other
    assert np.array_equal(thing.one, array)
    assert thing.one.strides == array.strides


def test_an_array_of_objects_holds_the_same_objects() -> None:
    part = [1]
    array = np.empty(2, object)
    array[:] = [part, "text"]
    found: Any = moved(array=array, part=part)
    assert found.array[0] is found.part
    assert found.array[1] == "text"


def test_a_view_still_shows_the_array_that_it_showed() -> None:
    base = np.arange(12.0).reshape(3, 4)
    found: Any = moved(base=base, view=base[::2, 1:][::-1])
    assert np.array_equal(found.view, base[::2, 1:][::-1])
    found.base[0, 1] = 77.0
    assert found.view[1, 0] == 77.0


def test_shared_objects_stay_shared_even_in_cycles() -> None:
    circle: list[Any] = [1]
    circle.append(circle)
    found: Any = moved(one=circle, other=circle)
    assert found.one is found.other
    assert found.one[1] is found.one


def test_an_object_that_stands_is_the_same_one_afterwards() -> None:
    inner, held = Thing(number=1), [1]
    thing: Any = Thing(inner=inner, held=held, bound=inner.method, called=partial(inner.method))
    entries = take(thing)
    untyped(inner).number, untyped(inner).extra, thing.held, thing.bound = 2, 3, [1, 2], None
    put(entries, thing)
    assert thing.inner is inner
    assert vars(inner) == {"number": 1}
    assert thing.held == [1]
    assert thing.bound() is inner
    assert thing.called() is inner


def test_an_object_that_stands_is_found_under_the_key_that_stands() -> None:
    key, held = Thing(), Speaking()
    thing: Any = Thing(key=key, table={key: held})
    entries = take(thing)
    held.number = 2
    put(entries, thing)
    assert thing.table == {key: held}
    assert held.number == 1


@pytest.mark.parametrize("instead", [lambda held: held.clear, lambda held: None])
def test_a_method_of_a_list_is_put_back_where_something_else_stands(instead: Callable[..., Any]) -> None:
    held = [1]
    thing: Any = Thing(held=held, call=held.append)
    entries = take(thing)
    thing.call = instead(held)
    put(entries, thing)
    thing.call(2)
    assert thing.held is held
    assert held == [1, 2]


def test_slots_without_a_value_have_none_afterwards() -> None:
    source, target = Slotted(), Slotted()
    untyped(source).b, untyped(target)._a = 1, 2
    entries = take(source)
    put(entries, target)
    assert untyped(target).b == 1
    assert not hasattr(target, "_a")


class Standing:
    """Something that has all attributes of another object besides its own."""

    __slots__ = ("_for", "note")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._for, name)


def test_a_substitute_object_has_its_own_attributes_only() -> None:
    thing, target = Thing(note="not its own"), Thing()
    standing: Any = Standing()
    standing._for = thing
    source = Thing(standing=standing)
    put(take(source), target)
    assert untyped(target).standing is not standing
    assert untyped(target).standing._for.note == "not its own"
    standing.note = "its own"
    put(take(source), target)
    assert (untyped(target).standing.note, untyped(target).standing._for.note) == ("its own", "not its own")


def test_immutable_objects_are_not_changed_in_place() -> None:
    thing: Any = Thing(series=TimeSeries({0.0: [1.0]}), value=Value(1))
    entries = take(thing)
    series, value = thing.series, thing.value
    thing.series, thing.value = later = TimeSeries({0.0: [2.0]}), Value(2)
    put(entries, thing)
    assert thing.series == series
    assert thing.value == value
    assert later == (TimeSeries({0.0: [2.0]}), Value(2))


def test_a_function_keeps_its_memory() -> None:
    count = 0

    def step() -> int:
        nonlocal count
        count += 1
        return count

    thing: Any = Thing(step=step)
    step()
    entries = take(thing)
    step()
    put(entries, thing)
    assert thing.step is step
    assert step() == 2


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_condition_may_have_any_function(name: str) -> None:
    """They are functions of Python and of NumPy, which has several kinds of them."""
    condition = Expression(f"{name}({', '.join(['x'] * (FUNCTIONS[name][0] or 2))})", {"x"})
    thing = Thing(condition=condition)
    put(take(thing), thing)
    assert untyped(thing).condition is condition


def test_a_generator_of_chance_draws_on_from_where_it_was() -> None:
    thing: Any = Thing(random=np.random.default_rng(3))
    thing.random.random(5)
    entries = take(thing)
    wanted = thing.random.random(3)
    put(entries, thing)
    assert np.array_equal(thing.random.random(3), wanted)
    assert np.array_equal(untyped(moved(random=np.random.Generator(np.random.Philox(2)))).random.random(), 0) is False


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (
            threading.Lock(),
            r"the state of thing\.inner\.value cannot be captured: it is a _thread\.lock; .*`uncaptured`",
        ),
        ((each for each in "ab"), r"it is a suspended generator, `<genexpr>`"),
        (threading.Thread(), r"it is a threading\.Thread"),
    ],
)
def test_objects_that_cannot_be_captured_are_refused_at_their_place(value: object, said: str) -> None:
    with pytest.raises(StateError, match=said):
        take(Thing(inner=Thing(value=value)))


def test_an_open_file_is_refused(tmp_path: Path) -> None:
    with open(tmp_path / "file", "w") as file, pytest.raises(StateError, match=r"it is a _io\.TextIOWrapper"):
        take(Thing(file=file))


def test_attributes_that_hold_no_state_stay_what_they_are() -> None:
    class Holder(Thing):
        uncaptured = ("lock",)

    thing: Any = Holder(lock=threading.Lock(), number=1)
    entries = take(thing)
    lock, thing.number = thing.lock, 2
    put(entries, thing)
    assert thing.lock is lock
    assert thing.number == 1


class Speaking:
    uncaptured = "*"

    def __init__(self) -> None:
        self.engine, self.number = threading.Lock(), 1

    def captured(self) -> dict[str, int]:
        return {"number": self.number}

    def check_state(self, state: Mapping[str, Any]) -> None:
        if state["number"] < 0:
            raise StateError("a negative number")

    def restored(self, state: Mapping[str, Any]) -> None:
        self.number = state["number"]


def test_an_object_may_tell_its_state_itself() -> None:
    thing: Any = Thing(speaking=Speaking())
    entries = take(thing)
    thing.speaking.number = 2
    put(entries, thing)
    assert thing.speaking.number == 1


def test_nothing_has_changed_where_a_state_is_refused() -> None:
    thing: Any = Thing(number=1, speaking=Speaking())
    thing.speaking.number = -1
    entries = take(thing)
    thing.number = thing.speaking.number = 2
    with pytest.raises(StateError, match="a negative number"):
        put(entries, thing)
    assert thing.number == thing.speaking.number == 2


def test_a_local_function_that_does_not_stand_is_not_made() -> None:
    with pytest.raises(StateError, match=r"the state of thing\.call cannot be restored here: the function .*<lambda>"):
        moved(call=lambda: 1)


def test_only_known_classes_and_data_classes_are_made() -> None:
    assert untyped(moved(value=Value(Thing(a=1)))).value.part.a == 1
    entries = take(Thing(value=Thing(a=1)))
    with pytest.raises(StateError, match=r"thing\.value cannot be restored here: the object of the class .*Thing"):
        Counterparts(entries, {"thing": Thing()}, {"other"})
