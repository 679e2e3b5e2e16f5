"""A signal is declared once; what makes no sense is refused where it is declared."""

from typing import Any

import numpy as np
import pytest
from simulating import present

from symaware_cli import Part, Quantity, Signal
from symaware_cli.core import GroupAwareness
from symaware_cli.recording.fields import signal_metadata, signal_of, signal_topic
from symaware_cli.recording.index import ChannelInfo

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


def test_signals_stand_among_the_columns_and_are_no_parts_of_awareness() -> None:
    awareness = GroupAwareness(np.zeros((2, 2)), "robot", signals={"look.points": POINTS})
    awareness["look.points"] = [[[1, 2]], []]
    assert [len(table) for table in awareness["look.points"]] == [1, 0]
    assert "look.points" not in awareness.parts


@pytest.mark.parametrize(
    "signal",
    [POINTS, Signal("effort", "vector", [Quantity("power", "W")]), Signal("plan", "series"), Part("mood", "series")],
)
def test_what_the_log_says_of_it_is_what_was_declared(signal: Signal) -> None:
    field = signal.name if isinstance(signal, Part) else signal.field("look")
    info = ChannelInfo(
        topic=signal_topic("robot", field, signal), metadata=signal_metadata(signal), schema="", encoding="", count=0
    )
    assert signal_of(info) == (field, signal)


def test_a_way_of_drawing_that_is_not_known_is_left_out() -> None:
    metadata = {**signal_metadata(POINTS), "drawn": "hologram"}
    info = ChannelInfo(topic="/agents/robot/points/look", metadata=metadata, schema="", encoding="", count=0)
    field, signal = present(signal_of(info))
    assert (field, signal.drawn, signal.columns) == ("look.points", None, PLACES)
