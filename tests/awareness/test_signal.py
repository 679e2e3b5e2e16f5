"""Signals and parts of awareness are declared as data: how they are stored, recorded and refused."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from simulating import present

from symaware_cli import Signal
from symaware_cli.awareness.awareness import SelfAwareness
from symaware_cli.awareness.readonly import readonly
from symaware_cli.core import PARTS, AwarenessDatabase, AwarenessVector, GroupAwareness, Part, Quantity, TimeSeries
from symaware_cli.log.fields import signal_metadata, signal_of, signal_topic
from symaware_cli.log.index import ChannelInfo

PLACES = (Quantity("x", "m"), Quantity("y", "m"))
POINTS = Signal("points", "table", PLACES, "points", "in the world")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("Points", "table", PLACES), "an identifier in lower case"),
        (("points", "heap", PLACES), "`kind` of the signal `points` is one of vector, series, table"),
        (("points", "table", PLACES, "bars"), "only a vector or a series is drawn as bars"),
        (("boxes", "vector", PLACES, "boxes"), "only a table is drawn as boxes"),
        (("boxes", "table", PLACES, "boxes"), "takes columns `x_low`, `x_high`, `y_low`, `y_high`"),
        (("areas", "table", PLACES, "areas"), "takes columns `x_low`, `x_high`, `y_low`, `y_high`, `occupied`"),
        (("points", "vector", PLACES[:1], "points"), "takes columns `x` and `y`, or `distance` and `bearing`"),
    ],
)
def test_a_declaration_that_makes_no_sense_is_refused(arguments: tuple[Any, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Signal(*arguments)


def test_a_part_of_awareness_is_no_table() -> None:
    with pytest.raises(ValueError, match="only a signal can be one"):
        Part("points", "table", PLACES)


def test_a_signal_is_known_by_its_component_and_a_measurement_by_that_alone() -> None:
    assert POINTS.field("look") == "look.points"
    assert Signal("measurement", "vector", PLACES).field("feel") == "feel"


def test_signals_are_columns_and_not_parts_of_awareness() -> None:
    awareness = GroupAwareness(np.zeros((2, 2)), "robot", signals={"look.points": POINTS})
    awareness["look.points"] = [[[1, 2]], []]
    assert [len(table) for table in awareness["look.points"]] == [1, 0]
    assert "look.points" not in awareness.parts


@pytest.mark.parametrize(
    "signal",
    [POINTS, Signal("effort", "vector", [Quantity("power", "W")]), Signal("plan", "series"), Part("mood", "series")],
)
def test_the_log_has_the_declaration_of_the_part(signal: Signal) -> None:
    field = signal.name if isinstance(signal, Part) else signal.field("look")
    info = ChannelInfo(
        topic=signal_topic("robot", field, signal), metadata=signal_metadata(signal), schema="", encoding="", count=0
    )
    assert signal_of(info) == (field, signal)


def test_an_unknown_way_of_drawing_is_left_out() -> None:
    metadata = {**signal_metadata(POINTS), "drawn": "hologram"}
    info = ChannelInfo(topic="/agents/robot/points/look", metadata=metadata, schema="", encoding="", count=0)
    field, signal = present(signal_of(info))
    assert (field, signal.drawn, signal.columns) == ("look.points", None, PLACES)


SHARES = Part("attention", "vector", [Quantity("ahead", "1"), Quantity("behind", "1")], drawn="bars")
MODES = Part("modes", "series")


@pytest.fixture
def awareness() -> GroupAwareness:
    return GroupAwareness(np.zeros((3, 2)), "robot", (SHARES, MODES))


def test_the_four_parts_that_every_group_has_are_declared_as_any_other() -> None:
    assert [part.name for part in PARTS] == ["state", "intent", "uncertainty", "risk"]
    assert list(GroupAwareness(np.zeros((3, 2))).columns) == ["state", "intent", "uncertainty", "risk"]


def test_a_vector_is_nan_and_not_worth_a_record_until_it_is_written(awareness: GroupAwareness) -> None:
    assert np.isnan(awareness["attention"]).all()
    assert awareness["attention"].shape == (3, 2)
    assert awareness.columns["attention"].take_changes() == []
    awareness["attention"] = np.full((3, 2), 0.5)
    assert awareness.columns["attention"].take_changes() is None


def test_an_agent_reads_and_writes_its_own_row_of_any_part(awareness: GroupAwareness) -> None:
    own = SelfAwareness("robot.1", awareness, 1)
    own["attention"] = [0.25, 0.75]
    own["modes"] = TimeSeries({0.0: [1, 0]})
    assert own["attention"].tolist() == [0.25, 0.75]
    assert own["modes"].values.tolist() == [[1, 0]]
    assert awareness["attention"][1].tolist() == [0.25, 0.75]
    assert awareness.columns["attention"].take_changes() == [1]
    assert [name for name, _ in own.items()] == ["state", "intent", "uncertainty", "risk", "attention", "modes"]


def test_an_undeclared_part_is_refused_with_the_declared_ones(awareness: GroupAwareness) -> None:
    own = SelfAwareness("robot.1", awareness, 1)
    refused: Callable[[], Any]
    for refused in (lambda: own["attenton"], lambda: awareness["attenton"]):
        with pytest.raises(KeyError, match=r"no part or signal `attenton`, only state, .*modes: a component declares"):
            refused()
    with pytest.raises(KeyError, match="no part or signal `attenton`"):
        own["attenton"] = [1.0]


def test_a_series_of_a_group_is_set_with_its_instants(awareness: GroupAwareness) -> None:
    with pytest.raises(TypeError, match="series for each agent"):
        awareness["modes"] = np.zeros((3, 1))
    awareness["modes"].set(0, np.ones((3, 1, 2)))
    assert awareness["modes"].row(2).values.tolist() == [[1, 1]]


def test_a_vector_of_an_unusual_length_is_refused(awareness: GroupAwareness) -> None:
    with pytest.raises(ValueError, match="shape"):
        SelfAwareness("robot.1", awareness, 1)["attention"] = [1.0, 2.0, 3.0]


def test_a_copy_has_all_parts_and_shares_no_mutable_data(awareness: GroupAwareness) -> None:
    own = SelfAwareness("robot.0", awareness, 0)
    own["attention"] = [0.5, 0.5]
    said = own.replaced(state=[1.0, 2.0])
    own["attention"] = [0.0, 1.0]
    assert type(said) is AwarenessVector
    assert said["attention"].tolist() == [0.5, 0.5]
    assert said.state.tolist() == [1.0, 2.0]
    assert "attention" in said
    assert "attention" not in AwarenessVector("robot.0", [0.0])
    assert pickle.loads(pickle.dumps(said))["attention"].tolist() == [0.5, 0.5]


def test_knowledge_holds_an_awareness_vector_that_cannot_be_changed_in_any_part() -> None:
    known = readonly(AwarenessVector("a", [0.0], attention=[1.0]), "told")
    assert known["attention"].tolist() == [1.0]
    with pytest.raises(TypeError):
        known["attention"] = [0.0]


def test_a_received_part_is_kept_beside_the_believed_state(awareness: GroupAwareness) -> None:
    database = AwarenessDatabase(SelfAwareness("robot.0", awareness, 0), awareness, 0)
    database.receive(AwarenessVector("robot.1", [9.0, 9.0], attention=[0.25, 0.75]), 0, alone=True)
    assert database["robot.1"]["attention"].tolist() == [0.25, 0.75]
    database["robot.1"] = AwarenessVector("robot.1", [1.0, 2.0])
    assert database["robot.1"].state.tolist() == [1.0, 2.0]
    assert database["robot.1"]["attention"].tolist() == [0.25, 0.75]
    database["robot.1"] = AwarenessVector("robot.1", [1.0, 2.0], attention=[1.0, 0.0])
    assert database["robot.1"]["attention"].tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"name": "my part"}, "identifier in lower case"),
        ({"name": "Attention"}, "identifier in lower case"),
        ({"name": "a", "kind": "matrix"}, "`kind` of the part `a` is one of vector, series"),
        (
            {"name": "a", "drawn": "cake"},
            "`drawn` of the part `a` is one of curve, path, ellipse, bars, points, links,",
        ),
        ({"name": "a", "merge": "both"}, "`merge` of the part `a` is one of"),
        ({"name": "a", "drawn": "path"}, "only a series is drawn as a path"),
        ({"name": "a", "columns": []}, "at least one"),
        ({"name": "a", "columns": ["x"]}, "a `Quantity` each"),
        ({"name": "a", "columns": [Quantity("x", "m"), Quantity("x", "s")]}, "same name"),
    ],
)
def test_a_contradictory_declaration_is_refused_at_its_place(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Part(**arguments)
