"""The awareness database: the beliefs of one agent about others, looked up on demand."""

import copy
import operator
import pickle
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from simulating import Team, execute, present, simulation

from symaware_cli import AwarenessVector, Component, PerceptionSystem, TimeSeries
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.models.integrator import DoubleIntegrator
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.world.motion_layout import as_motion
from symaware_cli.world.snapshot import StatesById


@pytest.fixture
def ready() -> Simulation:
    """Three agents of one group in a world."""
    return simulation({"robot": Team(count=3)})


def tracks(time: int, position: Sequence[float]) -> Tracks:
    """The first agent has a belief about the position of the second."""
    pointers, others = np.array([0, 1, 1, 1]), np.array([1])
    return Tracks(time, pointers, others, np.array([position]), np.zeros((1, 2)), np.eye(4)[None])


def test_a_view_has_present_beliefs_and_not_those_of_its_creation(ready: Simulation) -> None:
    group = ready.groups[0]
    database = group.agents[0].awareness_database
    group.awareness.seen = tracks(0, [1.0, 2.0])
    view = database["robot.1"]
    assert view.state.tolist() == [1.0, 2.0, 0.0, 0.0]
    assert np.array_equal(view.uncertainty.values, np.eye(4).reshape(1, 16))
    group.awareness.seen = tracks(5, [3.0, 4.0])
    assert view.state.tolist() == [3.0, 4.0, 0.0, 0.0]
    group.awareness.seen = None
    with pytest.raises(KeyError):
        view.state  # noqa: B018


def test_a_single_part_of_the_beliefs_about_another_can_be_written(ready: Simulation) -> None:
    group = ready.groups[0]
    database, plan = group.agents[0].awareness_database, TimeSeries({1.0: [9.0, 9.0]})
    group.awareness.seen = tracks(0, [1.0, 2.0])
    database["robot.1"].intent = plan
    group.awareness.seen = tracks(5, [3.0, 4.0])
    assert database["robot.1"].state.tolist() == [3.0, 4.0, 0.0, 0.0]
    assert database["robot.1"].intent == plan
    database["robot.1"].state = [5.0, 6.0]
    assert np.array_equal(database["robot.1"].state, [5.0, 6.0, np.nan, np.nan], equal_nan=True)
    assert not len(database["robot.1"].uncertainty)
    assert "robot.1" not in group.agents[1].awareness_database.others


def test_a_perception_that_returns_all_states_hands_over_one_table() -> None:
    class Sees(PerceptionSystem):
        def _compute(self) -> StatesById:
            return self.environment.snapshot().states_by_id

    ready = simulation({"car": Team({"see": Sees}, model=DoubleIntegrator()), "robot": Team({"see": Sees}, count=2)})
    execute(ready, 2)
    car, one, _ = (agent for group in ready.groups for agent in group.agents)
    assert [id for id, _ in one.awareness_database.items()] == ["robot.0", "car", "robot.1"]
    assert np.array_equal(car.awareness_database["robot.1"].state, [1.0, 0.0, np.nan, np.nan], equal_nan=True)
    shared = one.awareness_database.others.rows
    assert shared is car.awareness_database.others.rows is not None
    one.awareness_database["robot.1"] = AwarenessVector("robot.1", [7.0, 7.0, 0.0, 0.0])
    assert car.awareness_database["robot.1"].state[0] == 1.0
    assert one.awareness_database["robot.1"].state.tolist() == [7.0, 7.0, 0.0, 0.0]
    del one.awareness_database["robot.1"]
    assert list(one.awareness_database) == ["robot.0", "car"]


def test_perceptions_that_fill_dictionaries_with_the_same_rows_share_their_motions() -> None:
    class Fills(PerceptionSystem):
        def _compute(self) -> dict[str, Any]:
            return dict(self.environment.snapshot().states_by_id)

    ready = simulation({"robot": Team({"see": Fills}, count=3)})
    execute(ready, 2)
    one, other, _ = ready.groups[0].agents
    assert one.awareness_database.others.rows is other.awareness_database.others.rows is not None
    before = one.awareness_database["robot.1"].state
    execute(ready, 2)
    assert one.awareness_database["robot.1"].state is not before


def test_the_states_of_the_world_by_id_are_a_dictionary_that_cannot_be_changed(ready: Simulation) -> None:
    states = ready.environment.snapshot().states_by_id
    own = dict(states)

    def join() -> None:
        same = states
        same |= own

    assert list(own) == list(ready.environment.roster.ids)
    assert all(own[id] is row for id, row in states.items())
    for change in (
        lambda: states.update(own),
        lambda: states.clear(),
        lambda: states.pop("robot.0"),
        lambda: states.popitem(),
        lambda: states.setdefault("robot.9", own["robot.0"]),
        lambda: operator.setitem(states, "robot.0", own["robot.1"]),
        lambda: operator.delitem(states, "robot.0"),
        join,
    ):
        with pytest.raises(TypeError, match="change a copy"):
            change()
    assert dict(states) == own
    for copied in (pickle.loads(pickle.dumps(states)), copy.deepcopy(states)):
        assert type(copied) is StatesById
        assert {id: row.tolist() for id, row in copied.items()} == {id: row.tolist() for id, row in own.items()}


@pytest.mark.parametrize(
    "change",
    [
        lambda states: {**states, "robot.0": states["robot.1"], "robot.1": states["robot.0"]},
        lambda states: {id: row for id, row in states.items() if id != "robot.2"},
        lambda states: {id: row + 0.0 for id, row in states.items()},
        lambda states: dict(reversed(states.items())),
    ],
    ids=["exchanged", "fewer", "copied", "in another order"],
)
def test_a_dictionary_of_rows_of_the_world_means_what_one_of_other_arrays_means(
    ready: Simulation, change: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    states = change(dict(ready.environment.snapshot().states_by_id))
    one, other = (agent.awareness_database for agent in ready.groups[0].agents[:2])
    one.set_states(states)
    other.set_states({id: row.tolist() for id, row in states.items()})
    for id in {*states} - {"robot.0", "robot.1"}:
        assert np.array_equal(one[id].state, other[id].state, equal_nan=True)
    assert one["robot.0"].state.tolist() == states["robot.0"].tolist()
    assert one["robot.1"].state[:2].tolist() == states["robot.1"].tolist()
    assert sorted(one) == sorted({*states, "robot.0"})


def test_states_that_can_change_are_converted_each_time(ready: Simulation) -> None:
    database = ready.groups[0].agents[0].awareness_database
    table = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    states = dict(zip(ready.groups[0].ids, table, strict=True))
    for writeable in (True, False):
        # Rows made before the table is frozen can still be written.
        table.flags.writeable = writeable
        for position in ([7.0, 8.0], [9.0, 10.0]):
            states["robot.1"][:] = position
            database.set_states(states)
            assert database["robot.1"].state[:2].tolist() == position


@pytest.mark.parametrize("whole", [True, False])
def test_a_dictionary_of_states_is_taken_over_whole_or_one_by_one_with_the_same_outcome(
    ready: Simulation, whole: bool
) -> None:
    agent = ready.groups[0].agents[1]
    states = {"robot.0": np.array([1.0, 2.0]), "robot.1": np.array([3.0, 4.0]), "robot.2": np.array([5.0, 6.0])}
    agent.awareness_database.set_states(states if whole else {**states, "robot.0": [1, 2]})
    assert agent.self_state.tolist() == [3.0, 4.0]
    assert list(agent.awareness_database) == ["robot.1", "robot.0", "robot.2"]
    for id in ("robot.0", "robot.2"):
        expected = [*states[id], np.nan, np.nan]
        assert np.array_equal(agent.awareness_database[id].state, expected, equal_nan=True)
    states["robot.0"][:] = 9.0
    assert agent.awareness_database["robot.0"].state[0] == 1.0


@pytest.mark.parametrize("width", [2, 4])
def test_positions_and_motions_become_the_same_rows_whole_as_one_by_one(ready: Simulation, width: int) -> None:
    roster = ready.environment.roster
    states = {id: np.arange(width) + 10.0 * row for row, id in enumerate(roster.ids)}
    places, motions, _ = present(roster.motions(states))
    for id, state in states.items():
        alone = as_motion(id, state, roster.model(id), roster.dimensions, is_state=True)
        assert np.array_equal(motions[places[id]], alone, equal_nan=True)


def test_beliefs_about_others_are_equal_in_another_process(ready: Simulation) -> None:
    database = ready.groups[0].agents[0].awareness_database
    database["robot.2"] = AwarenessVector("robot.2", [7.0, 7.0, 0.0, 1.0])
    copied = pickle.loads(pickle.dumps(database.others))
    assert [*copied] == [*database.others]
    assert copied["robot.2"].state.tolist() == [7.0, 7.0, 0.0, 1.0]


def test_views_are_cached_and_bulk_access_creates_none(ready: Simulation) -> None:
    group = ready.groups[0]
    group.awareness.world = ready.environment.snapshot()
    database = group.agents[0].awareness_database
    first = dict(database.items())
    ready.environment.step()
    group.awareness.world = ready.environment.snapshot()
    assert all(view is first[id] for id, view in database.items())


def test_a_view_is_copied_and_sent_as_a_value(ready: Simulation) -> None:
    group = ready.groups[0]
    group.awareness.seen = tracks(0, [1.0, 2.0])
    copy = pickle.loads(pickle.dumps(group.agents[0].awareness_database["robot.1"]))
    group.awareness.seen = tracks(5, [3.0, 4.0])
    assert type(copy) is AwarenessVector
    assert copy.state.tolist() == [1.0, 2.0, 0.0, 0.0]


class Guesses(Component):
    """Writes the intent and the risk of another, while others perceive it."""

    def _compute(self) -> TimeSeries:
        return TimeSeries({1.0: [4.0, 5.0]})

    def _update(self, value: TimeSeries) -> None:
        for id, vector in self._agent.awareness_database.items():
            if id != self._agent.id:
                vector.intent = value


def test_values_of_agent_and_group_components_are_kept_together() -> None:
    ready = simulation({"robot": Team({"see": OmniscientPerception, "guess": Guesses}, count=2)})
    execute(ready, 3)
    vector = ready.groups[0].agents[0].awareness_database["robot.1"]
    assert vector.state.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert vector.intent == TimeSeries({1.0: [4.0, 5.0]})


def test_columns_agree_with_the_views() -> None:
    ready = simulation({"robot": Team({"see": SelfPerception}, count=3)})
    execute(ready, 1)
    group = ready.groups[0]
    group.awareness.seen = tracks(0, [1.0, 2.0])
    database = group.agents[0].awareness_database
    database["robot.2"] = AwarenessVector("robot.2", [7.0, 8.0, 9.0, 10.0])
    columns = database.tracks(ready.clock.now)
    assert columns.others.tolist() == [1, 2]
    for id, motion in zip(("robot.1", "robot.2"), columns.motions, strict=True):
        assert database[id].state.tolist() == motion.tolist()
    assert columns.covariances is not None
    assert np.array_equal(columns.covariances, [np.eye(4), np.zeros((4, 4))])
