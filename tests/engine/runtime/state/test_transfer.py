"""State on its way between two processes that have counterparts of the same objects; here both ends are in one."""

import threading
from typing import Any

import numpy as np
import pytest
from simulating import untyped

from symaware_cli.core import TimeSeries
from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.state.transfer import Transfer


class Thing:
    """Something with attributes."""

    uncaptured = ("solver",)

    def __init__(self, **attributes: Any) -> None:
        vars(self).update(attributes)


class Mark:
    """Something of which only the identity matters."""


@pytest.fixture
def ends() -> list[tuple[Transfer, Thing, Thing]]:
    """A thing and its world at each of two ends."""
    made = []
    for name in ("here", "there"):
        world = Thing(size=name)
        thing = Thing(world=world, solver=name)
        end = Transfer({__name__, "symaware_cli"})
        end.name({"world": world, "thing": thing})
        made.append((end, thing, world))
    return made


def test_a_value_refers_to_what_stands_at_the_other_end(ends: list[tuple[Transfer, Thing, Thing]]) -> None:
    (here, thing, world), (there, other_thing, other_world) = ends
    series = TimeSeries({0.5: [1.0]})
    found = there.put(here.taken((), {"value": [thing, world, series, np.arange(3)]}))["value"]
    assert found[0] is other_thing
    assert found[1] is other_world
    assert found[2] == series
    assert np.array_equal(found[3], [0, 1, 2])
    assert other_world.size == "there"


def test_the_state_of_a_named_object_is_transferred_except_attributes_without_state(
    ends: list[tuple[Transfer, Thing, Thing]],
) -> None:
    (here, thing, _), (there, other_thing, other_world) = ends
    untyped(thing).plan = [1, {"two": np.ones(2)}]
    there.put(here.taken(["thing"]))
    assert untyped(other_thing).plan[0] == 1
    assert np.array_equal(untyped(other_thing).plan[1]["two"], [1.0, 1.0])
    assert (untyped(other_thing).world, untyped(other_thing).solver) == (other_world, "there")
    del untyped(thing).plan
    there.put(here.taken(["thing"]))
    assert not hasattr(other_thing, "plan")


def test_the_same_state_is_the_same_bytes_at_both_ends(ends: list[tuple[Transfer, Thing, Thing]]) -> None:
    (here, thing, _), (there, other_thing, _) = ends
    untyped(other_thing).first = 0
    untyped(thing).plan, untyped(thing).first = np.arange(4.0), {"b", "a"}
    data = here.taken(["thing"])
    there.put(data)
    assert there.taken(["thing"]) == data


def test_changed_values_are_new_objects(ends: Any) -> None:
    """A cache that compares identities at the other end would otherwise be taken for fresh."""
    (here, thing, _), (there, other_thing, _) = ends
    thing.version, thing.table = Mark(), [1]
    there.put(here.taken(["thing"]))
    version, table = other_thing.version, other_thing.table
    thing.version = Mark()
    there.put(here.taken(["thing"]))
    assert isinstance(other_thing.version, Mark)
    assert other_thing.version is not version
    assert other_thing.table is not table


def test_content_that_cannot_be_sent_is_refused_at_its_place(ends: Any) -> None:
    (here, thing, _), _ = ends
    thing.plan = {"lock": threading.Lock()}
    with pytest.raises(StateError, match=r"the state of thing\.plan\['lock'\] cannot be captured: it is a .*lock"):
        here.taken(["thing"])


def test_nothing_has_changed_where_something_cannot_be_made_at_the_other_end(ends: Any) -> None:
    (here, thing, _), (there, other_thing, _) = ends
    thing.first, thing.plan = 1, Thing()  # has attributes that hold no state, so that it is not made of the others
    with pytest.raises(StateError, match=r"thing\.plan cannot be restored here"):
        there.put(here.taken(["thing"]))
    assert not hasattr(other_thing, "first")
