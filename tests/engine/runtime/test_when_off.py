"""What the values of a component are while its condition does not hold."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from simulating import Team, execute, simulation

import symaware_cli as sa
from symaware_cli.core import Component, GroupComponent, Quantity, Signal, TimeSeries
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.specification.expression import Expression
from symaware_cli.world.probability_distribution import always

COLUMNS = (Quantity("one", "m"),)
SIGNALS = tuple(Signal(kind, kind, COLUMNS) for kind in ("vector", "series", "table"))
MODES = pytest.mark.parametrize("options", [RunOptions(), RunOptions(mode="asynchronous")], ids=["steps", "between"])


class Single(Component):
    """Writes a risk, each kind of signal, its state and its control input."""

    signals: ClassVar[Sequence[Signal]] = SIGNALS

    def _compute(self) -> Any:
        return self.time

    def _update(self, value: Any) -> None:
        agent = self._agent
        agent.model.control_input = [1.0, 0.0]
        agent.self_awareness.state = agent.self_state + 0.01
        agent.self_awareness.risk = TimeSeries({value: [value]})
        for signal in SIGNALS:
            self.record(
                signal, {"vector": [value], "series": TimeSeries({value: [value]}), "table": [[value]]}[signal.kind]
            )


class Grouped(GroupComponent):
    """The same for the whole group."""

    signals: ClassVar[Sequence[Signal]] = SIGNALS

    def _compute(self) -> Any:
        return self.time

    def _update(self, value: Any) -> None:
        group, now = self._group, self.now
        group.control_input = np.tile([1.0, 0.0], (2, 1))
        group.awareness.state = group.awareness.state + 0.01
        group.awareness.risk.set([now], np.full((2, 1), value))
        for signal in SIGNALS:
            column = np.full((2, 1), value)
            self.record(signal, {"vector": column, "series": ([now], column), "table": [[[value]]] * 2}[signal.kind])


@MODES
@pytest.mark.parametrize("kind", [Single, Grouped])
@pytest.mark.parametrize("latency", [0.0, 0.1])
@pytest.mark.parametrize("when_off", ["hold", "clear"])
def test_values_are_held_or_cleared_while_the_condition_is_false(
    kind: type, latency: float, when_off: Literal["hold", "clear"], options: RunOptions
) -> None:
    condition = Expression("time < 0.12 or time > 0.38", {"time"})
    timing = Timing(condition=condition, when_off=when_off, latency=always(latency))
    ready = simulation({"a": Team({"it": kind}, count=2, timings={"it": timing})})
    execute(ready, 7, options=options)
    (group,) = ready.groups
    last = 0.1  # the last turn before the condition ends, which lands later with a latency
    assert group.control_input.tolist() == [[1.0, 0.0]] * 2
    assert (group.awareness.state > 0).all()
    for row in range(2):
        values = [
            group.awareness.risk.row(row).values.ravel().tolist(),
            group.awareness.columns["it.series"].row(row).values.ravel().tolist(),  # type: ignore[union-attr]
            group.awareness.columns["it.table"].row(row).ravel().tolist(),  # type: ignore[union-attr]
            [each for each in group.awareness.columns["it.vector"].row(row).tolist() if each == each],  # type: ignore[union-attr]
        ]
        assert values == [[last] if when_off == "hold" else []] * 4


@pytest.mark.parametrize("when_off", ["hold", "clear"])
def test_other_components_see_the_risk_that_is_left(when_off: str, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(f"""\
symaware: 1
name: s
run: {{duration: 1.0}}
environment: {{use: kinematic, with: {{time_step: 0.05}}}}
agents:
  robot:
    count: 2
    model: {{use: single-integrator}}
    state: [[0, 0], [4, 0.1]]
    entity: {{shape: {{circle: {{radius: 0.3}}}}}}
    knowledge: {{goal: [[4, 0], [-4, 0]]}}
    components:
      see: {{use: perception.omniscient}}
      risk: {{use: risk.time-to-collision, with: {{horizon: 8.0}}, condition: time < 0.2, when_off: {when_off}}}
      steer: {{use: control.go-to-goal}}
""")
    with sa.load(tmp_path / "s.yaml").start() as simulation:
        simulation.step(3)
        assert simulation.awareness("robot.0", "risk")[0] > 0
        simulation.step(5)
        left = simulation.awareness("robot.0", "risk")[0]
    assert left > 0 if when_off == "hold" else np.isnan(left)


def test_a_value_without_effect_while_off_is_refused(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("""\
symaware: 1
name: s
run: {duration: 1.0}
environment: {use: kinematic}
agents:
  robot: {model: {use: single-integrator}, components: {see: {use: perception.self, when_off: clear}}}
""")
    with pytest.raises(sa.ScenarioError, match="`when_off` has an effect only with a condition"):
        sa.load(tmp_path / "s.yaml")
