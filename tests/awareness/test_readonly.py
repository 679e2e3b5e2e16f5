"""Values of knowledge are deeply read-only, and errors name the assignment to write instead."""

import copy
import pickle
from array import array
from collections import OrderedDict, UserList, deque, namedtuple
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulating import Team, present, simulate
from talking import Setting

from symaware_cli import Agent, AgentGroup, AwarenessVector, Component, KnowledgeDatabase, TimeSeries, open_log
from symaware_cli.engine.components.communication.equality import same

CHANGES: dict[str, tuple[Any, Callable[[Any], object]]] = {
    "append to a list": ([1], lambda known: known.append(2)),
    "extend a list": ([1], lambda known: known.extend([2])),
    "add to a list in place": ([1], lambda known: known.__iadd__([2])),
    "set an element of a list": ([1], lambda known: known.__setitem__(0, 2)),
    "delete an element of a list": ([1], lambda known: known.__delitem__(0)),
    "sort a list": ([2, 1], lambda known: known.sort()),
    "append to a list in a list": ([[1]], lambda known: known[0].append(2)),
    "set an element of a tuple's list": (([1],), lambda known: known[0].__setitem__(0, 2)),
    "set a key": ({"a": 1}, lambda known: known.__setitem__("a", 2)),
    "update a mapping": ({"a": 1}, lambda known: known.update(a=2)),
    "merge into a mapping": ({"a": 1}, lambda known: known.__ior__({"a": 2})),
    "pop from a mapping": ({"a": 1}, lambda known: known.pop("a")),
    "set a default": ({"a": 1}, lambda known: known.setdefault("b", 2)),
    "append in a mapping": ({"a": [1]}, lambda known: known["a"].append(2)),
    "set a key of an ordered mapping": (OrderedDict(a=1), lambda known: known.__setitem__("a", 2)),
    "set an element of an array": (np.zeros(2), lambda known: known.__setitem__(0, 9.0)),
    "set an element of a row": (np.zeros((2, 2)), lambda known: known[1].__setitem__(0, 9.0)),
    "add to an array in place": (np.zeros(2), lambda known: known.__iadd__(1.0)),
    "fill an array": (np.zeros(2), lambda known: known.fill(1.0)),
    "sort an array": (np.array([2.0, 1.0]), lambda known: known.sort()),
    "set an element of an array in a list": ([np.zeros(2)], lambda known: known[0].__setitem__(0, 9.0)),
    "append in an array of objects": (np.array([[1], None], object), lambda known: known[0].append(2)),
    "add to a set": ({1}, lambda known: known.add(2)),
    "update a set": ({1}, lambda known: known.__ior__({2})),
    "append to a queue": (deque([1]), lambda known: known.append(2)),
    "append to an array of numbers": (array("d", [1.0]), lambda known: known.append(2.0)),
    "append to a list of a class of its own": (UserList([1]), lambda known: known.append(2)),
    "give an array another shape": (np.zeros(2), lambda known: setattr(known, "shape", (2, 1))),
    "set the state of a vector": (AwarenessVector("a", [1.0]), lambda known: setattr(known, "state", [2.0])),
}


@pytest.mark.parametrize("how", CHANGES)
def test_to_change_it_in_place_is_refused_with_the_assignment_to_write(how: str) -> None:
    value, change = CHANGES[how]
    known = KnowledgeDatabase({"bag": value})
    for database in (known, pickle.loads(pickle.dumps(known["bag"]))):
        held = known["bag"] if database is known else database
        before = repr(held)
        with pytest.raises(TypeError, match=r'self_knowledge\["bag"\] = '):
            change(held)
        assert repr(held) == before


@pytest.mark.parametrize("how", CHANGES)
def test_a_deep_copy_is_there_to_be_changed(how: str) -> None:
    value, change = CHANGES[how]
    change(copy.deepcopy(KnowledgeDatabase({"bag": value})["bag"]))


def test_every_way_to_write_knowledge_makes_it_read_only() -> None:
    known = KnowledgeDatabase({"start": [1]})
    known["set"] = [1]
    known.update({"update": [1]}, word=[1])
    known |= {"merge": [1]}
    known.setdefault("default", [1])
    known.replace({**known, "replace": [1]})
    assert sorted(known) == ["default", "merge", "replace", "set", "start", "update", "word"]
    for value in known.values():
        with pytest.raises(TypeError):
            value.append(2)


def test_changes_of_the_original_do_not_reach_the_copy() -> None:
    array, inner = np.zeros(2), [1]
    known = KnowledgeDatabase({"goal": array, "bag": [inner]})
    array[0], inner[0] = 9.0, 9
    assert known["goal"].tolist() == [0.0, 0.0]
    assert known["bag"] == [[1]]
    with pytest.raises(ValueError, match="read-only"):
        np.add(known["goal"], 1.0, out=known["goal"])
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(known["goal"])[0] = 9.0


def test_arrays_and_lists_can_be_used_in_computations() -> None:
    known = KnowledgeDatabase({"goal": np.array([3.0, 4.0]), "list": [3.0, 4.0]})
    state = np.array([1.0, 1.0])
    for goal in (known["goal"], known["list"]):
        way = goal - state
        assert type(way) is np.ndarray
        way += 1.0
        assert way.tolist() == [3.0, 4.0]
        assert float(np.linalg.norm(goal)) == 5.0
    assert type(known["goal"].copy()) is np.ndarray
    assert type(known["goal"].sum()) is np.float64
    assert known["list"] == [3.0, 4.0] == known["list"]
    assert known["list"] != [3.0]
    assert known["list"] != (3.0,)
    assert known["list"] + [5.0] == [3.0, 4.0, 5.0]
    assert [2.0] + known["list"] == [2.0, 3.0, 4.0]


Pair = namedtuple("Pair", "one other")
plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.binary(max_size=3)
values = st.recursive(
    plain | st.lists(st.floats(), max_size=3).map(np.array) | st.sets(st.integers(), max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=2), inner, max_size=3)
        | st.tuples(inner, inner).map(lambda pair: Pair(*pair))
        | st.dictionaries(st.text(max_size=2), inner, max_size=3).map(MappingProxyType)
    ),
    max_leaves=6,
)


@given(values)
def test_read_only_values_equal_the_assigned_ones(value: Mapping[str, Mapping[str, Any]] | Pair | None) -> None:
    known = KnowledgeDatabase({"it": value})["it"]
    assert same(known, value)
    assert same(pickle.loads(pickle.dumps(known)), known)
    assert same(copy.deepcopy(known), known)


@pytest.mark.parametrize("kind", ["list", "mapping", "array", "deep"])
def test_cyclic_values_are_refused_where_they_are_written(kind: str, tmp_path: Path) -> None:
    class Writes(Component):
        def _compute(self) -> bool:
            return self._agent.row == 1 and self.time >= 0.1

        def _update(self, value: bool) -> None:
            if not value:
                return
            bag: Any = {"list": [], "mapping": {}, "array": np.empty(1, object), "deep": []}[kind]
            if kind == "list":
                bag.append([bag])
            elif kind == "mapping":
                bag["bag"] = {"inner": bag}
            elif kind == "array":
                bag[0] = bag
            else:
                for _ in range(5000):
                    bag = [bag]
            self._agent.self_knowledge["bag"] = bag

    log = tmp_path / "log"
    summary = simulate({"robot": Team({"write": Writes}, count=2)}, 5, log)
    assert summary.status == "failed"
    assert summary.failure is not None
    assert summary.failure.startswith(
        "agents.robot.1.write (test.write) failed at 0.1 s: ValueError: the knowledge `bag`"
    )
    assert present(open_log(log).outcome)["status"] == "failed"


def test_the_knowledge_itself_can_be_assigned_to_an_entry() -> None:
    known = KnowledgeDatabase({"goal": 1})
    known["all"] = known
    assert known == {"goal": 1, "all": {"goal": 1}}


def test_all_that_is_assigned_is_in_the_log(tmp_path: Path) -> None:
    def act(agent: Agent) -> None:
        known = agent.self_knowledge
        known["bag"] = [*known["bag"], agent.surroundings.clock.now]
        known["goal"] = known["goal"] + 1.0
        known["vector"] = AwarenessVector("x", [1.0], TimeSeries({1.0: [2.0]}))
        known["set"] = {3, 1}

    knowledge = [{"bag": [], "goal": np.zeros(2)}]
    simulate({"robot": Team({"act": lambda: Setting(act)}, knowledge=knowledge)}, 3, tmp_path / "log")
    entries = list(open_log(tmp_path / "log").knowledge("robot"))
    assert [len(entry.values["bag"]) for entry in entries] == [1, 2, 3, 4][: len(entries)]
    assert entries[0].values["goal"] == [1.0, 1.0]
    assert entries[0].values["set"] == [1, 3]
    assert entries[0].values["vector"]["state"] == [1.0]


class TestWhatAGroupKnows:
    def group(self, *knowledge: Mapping[str, Any]) -> AgentGroup:
        return Team(count=len(knowledge), knowledge=knowledge).group("robot")

    def test_is_the_same_array_until_something_changes(self) -> None:
        robots = self.group({"goal": [1, 2], "map": 1}, {"goal": [3, 4], "map": 2})
        first = robots.known("goal")
        robots.knowledge[0]["map"] = 5
        robots.knowledge[0]["goal"] = (1.0, 2.0)
        assert robots.known("goal") is first
        robots.knowledge[1]["goal"] = [5, 6]
        second = robots.known("goal")
        assert second.tolist() == [[1.0, 2.0], [5.0, 6.0]]
        assert first.tolist() == [[1.0, 2.0], [3.0, 4.0]]
        assert robots.known("goal") is second
        assert not second.flags.writeable

    @given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3), st.integers(0, 3)), max_size=20))
    def test_is_what_each_of_them_knows_after_any_changes(self, changes: Sequence[tuple[int, int, int]]) -> None:
        robots = self.group(*({"goal": [float(row)], "line": [[0.0, row]]} for row in range(5)))
        for row, value, length in changes:
            robots.knowledge[row]["goal"] = [value]
            robots.knowledge[row]["line"] = [[step, value] for step in range(length)]
            lists, counts = robots.known_lists("line")
            for own, line, count in zip(robots.knowledge, lists, counts, strict=True):
                assert line[:count].tolist() == [list(each) for each in own["line"]]
                assert (line[count:] == (line[count - 1] if count else 0.0)).all()
        assert robots.known("goal").tolist() == [list(own["goal"]) for own in robots.knowledge]

    def test_that_is_not_numbers_of_one_shape_is_refused_again_and_again_until_it_is(self) -> None:
        robots = self.group({"goal": [1, 2]}, {"goal": [3, 4]})
        robots.known("goal")
        for bad in ([1], "text", None, [1j, 0], [[1, 2]]):
            robots.knowledge[0]["goal"] = bad
            for _ in range(2):
                with pytest.raises(ValueError, match="`goal` of the agents must be numbers of one shape"):
                    robots.known("goal")
        robots.knowledge[0]["goal"] = [7, 8]
        assert robots.known("goal").tolist() == [[7.0, 8.0], [3.0, 4.0]]
        del robots.knowledge[0]["goal"]
        with pytest.raises(KeyError, match="does not know `goal`"):
            robots.known("goal")
