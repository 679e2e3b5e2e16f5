"""Rosters and snapshots: the indices and states of agents."""

import numpy as np
import pytest

from symaware_cli import Roster, Snapshot
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle

MEMBERS = {"robot": ["robot.0", "robot.1"], "car": ["car"]}


def test_the_roster_does_not_depend_on_the_order_of_the_groups() -> None:
    one, other = Roster(MEMBERS), Roster(dict(reversed(MEMBERS.items())))
    assert one.ids == other.ids == ("car", "robot.0", "robot.1")
    assert one.groups == ("car", "robot")
    assert one.starts == (0, 1)
    assert one.counts == (1, 2)
    assert len(one) == 3


def test_eleven_agents_are_ordered_by_index_and_not_by_name() -> None:
    ids = [f"robot.{row}" for row in range(11)]
    assert Roster({"robot": ids}).ids == tuple(ids)


def test_the_roster_finds_the_group_and_row_of_an_agent() -> None:
    roster = Roster(MEMBERS)
    assert roster.place("robot.1") == (1, 1)
    assert "car" in roster
    assert "bus" not in roster
    with pytest.raises(KeyError):
        roster.place("bus")


def test_a_snapshot_joins_groups_of_different_models_by_index() -> None:
    snapshot = Snapshot(
        0,
        Roster(MEMBERS),
        [Unicycle(), SingleIntegrator()],
        [np.array([[1.0, 2.0, np.pi / 2]]), np.array([[3.0, 4.0], [5.0, 6.0]])],
        [np.array([[2.0, 0.0]]), np.array([[0.5, 0.0], [0.0, 0.5]])],
    )
    assert snapshot.positions.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert np.allclose(snapshot.velocities, [[0.0, 2.0], [0.5, 0.0], [0.0, 0.5]])
    assert snapshot.state("robot.1").tolist() == [5.0, 6.0]
    assert snapshot.positions is snapshot.positions
    with pytest.raises(KeyError):
        snapshot.state("bus")
