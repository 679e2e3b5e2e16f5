"""From risk to action: who is at risk slows down."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError
from simulating import Team, execute, simulation

from symaware_cli import Controller, Entity, Event, GroupComponent, RiskEstimator, TimeSeries
from symaware_cli.engine.components.control.goal import GoToGoal
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.components.risk.time_to_collision import TimeToCollision
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.planning.control.risk_aware import RiskAware

DISC = Entity.model_validate({"shape": {"circle": {"radius": 0.3}}})


class Told(GroupComponent):
    """A risk that follows a script: a value for each step."""

    def __init__(self, script: Sequence[float]) -> None:
        super().__init__()
        self.script = iter(script)

    def _compute(self) -> NDArray[np.float64]:
        return np.full(len(self._group), float(next(self.script)))

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.awareness.risk.set(self.now, value)


class Ahead(GroupComponent):
    """Goes one metre per second along x, in the steps that are not left out."""

    def __init__(self, asleep: tuple[int, ...] = ()) -> None:
        super().__init__()
        self.asleep = asleep

    def _compute(self) -> bool:
        return self.now // self.environment.time_step not in self.asleep

    def _update(self, value: bool) -> None:
        if value:
            self._group.control_input = np.tile([1.0, 0.0], (len(self._group), 1))


class Brake(RiskAware):
    def __init__(self, **parameters: float) -> None:
        super().__init__(self.Parameters(**parameters))


def told(script: Sequence[float], asleep: tuple[int, ...] = (), **parameters: float) -> tuple[list[float], list[str]]:
    """The speed that is left at each step of a script of risks, and the events."""
    team = Team({"risk": lambda: Told(script), "steer": lambda: Ahead(asleep), "brake": lambda: Brake(**parameters)}, 1)
    ready = simulation({"robot": team})
    speeds, events = [], []
    ready.events.subscribe("stepped", lambda _: speeds.append(ready.groups[0].control_input[0, 0]))
    for name in RiskAware.events:
        ready.events.subscribe(name, lambda event: events.append(event.name))
    execute(ready, len(script))
    return speeds, events


def test_the_speed_falls_from_caution_to_bound() -> None:
    speeds, _ = told([0.0, 0.3, 0.5, 0.6, 0.7, 1.0], caution=0.3, bound=0.7)
    assert speeds == pytest.approx([1.0, 1.0, 0.5, 0.25, 0.0, 0.0])


def test_the_speed_falls_at_once_and_recovers_at_its_rate() -> None:
    speeds, _ = told([0.0, 1.0, 0.0, 0.0, 0.0, 0.0], recovery=8.0)  # in steps of 0.05 s
    assert speeds == pytest.approx([1.0, 0.0, 0.4, 0.8, 1.0, 1.0])


def test_each_event_is_announced_once_in_an_episode() -> None:
    _, events = told([0.0, 0.5, 0.6, 1.0, 0.6, 1.0, 0.0, 0.0, 0.5, 0.0], recovery=20.0)
    assert events == ["slowed", "stopped", "resumed", "slowed", "resumed"]


def test_a_slowed_request_is_not_slowed_again_while_the_controller_pauses() -> None:
    speeds, _ = told([0.5] * 4, asleep=(1, 2))
    assert speeds == pytest.approx([0.5] * 4)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20), st.floats(0, 0.4), st.floats(0.5, 1.0), st.floats(0.1, 30))
def test_the_speed_never_exceeds_what_the_risk_allows_nor_jumps_up(
    script: list[float], caution: float, bound: float, recovery: float
) -> None:
    speeds, _ = told(script, caution=caution, bound=bound, recovery=recovery)
    allowed = np.clip((bound - np.array(script)) / (bound - caution), 0, 1)
    assert (np.array(speeds) <= allowed + 1e-12).all()
    assert (np.diff(speeds) <= recovery * 0.05 + 1e-12).all()


def test_without_a_risk_nothing_is_slowed() -> None:
    team = Team({"steer": Ahead, "brake": Brake}, 3)
    ready = simulation({"robot": team})
    execute(ready, 3)
    assert ready.groups[0].control_input.tolist() == [[1.0, 0.0]] * 3


def test_it_works_with_components_of_single_agents() -> None:
    class Fear(RiskEstimator):
        def _compute(self) -> TimeSeries:
            return TimeSeries({0.0: [0.1], 1.0: [0.5]}) if self._agent.row else TimeSeries()

    class Walk(Controller):
        def _compute(self) -> tuple[list[float], TimeSeries]:
            return [1.0, 0.0], TimeSeries()

    ready = simulation({"robot": Team({"risk": Fear, "steer": Walk, "brake": Brake}, 2)})
    execute(ready, 3)
    assert ready.groups[0].control_input[:, 0] == pytest.approx([1.0, 0.5])  # the greatest of the series counts


def crossing(model: NoisyModel, brake: bool) -> Simulation:
    """Two who cross at right angles, of whom only the second can brake."""
    rest = len(model.state) - 2
    east, north = [[0.0] * rest, [np.pi / 2]] if isinstance(model, Unicycle) else [[0.0] * rest] * 2
    steer = lambda: GoToGoal(GoToGoal.Parameters(speed=1.0))  # noqa: E731
    first = Team(
        {"sense": SelfPerception, "steer": steer}, 1, [[-4.0, 0.0, *east]], [{"goal": [4.0, 0.0]}], model, DISC
    )
    second = Team(
        {
            "sense": OmniscientPerception,
            "risk": lambda: TimeToCollision(TimeToCollision.Parameters(horizon=4.0, margin=0.2)),
            "steer": steer,
            **({"brake": Brake} if brake else {}),
        },
        1,
        [[0.0, -4.1, *north]],
        [{"goal": [0.0, 4.0]}],
        model,
        DISC,
    )
    return simulation({"first": first, "second": second})


@pytest.mark.parametrize("model", [SingleIntegrator(), Unicycle(), DoubleIntegrator()], ids=lambda m: type(m).__name__)
def test_an_agent_that_brakes_lets_the_other_pass_and_arrives(model: NoisyModel) -> None:
    assert execute(crossing(model, brake=False), 400).contacts > 0
    ready = crossing(model, brake=True)
    slowed: list[Event] = []
    ready.events.subscribe("slowed", slowed.append)
    summary = execute(ready, 400)
    assert summary.contacts == 0
    assert len(summary.goals_reached) == 2
    assert {event.source for event in slowed} == {"agents.second.0.brake"}
    assert len(slowed) <= 3


def test_caution_comes_before_the_bound() -> None:
    with pytest.raises(ValidationError, match=r"caution \(0.8\) must be less than bound \(0.7\)"):
        RiskAware.Parameters(caution=0.8)
