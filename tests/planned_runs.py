"""Runs in which agents plan paths: logs, events of planners, and continuation from captured states."""

from pathlib import Path

import numpy as np

import symaware_cli as sa


def run(room: Path, name: str = "log") -> sa.Log:
    """Run the scenario of a folder."""
    sa.load(room / "scenario.yaml").run(output=room / f"{name}.mcap")
    return sa.open_log(room / f"{name}.mcap")


def names(log: sa.Log, agent: str) -> list[str]:
    """Return the events of an agent, except those of passed waypoints."""
    return [
        event.name
        for event in log.events()
        if event.source.startswith(f"agents.{agent}.") and event.name != "waypoint-reached"
    ]


def check_capture(room: Path, steps: int) -> None:
    """Check that a run continues equally for some steps from a state that was captured after 20."""
    scenario = sa.load(room / "scenario.yaml")
    with scenario.start() as simulation:
        simulation.step(20)
        state = simulation.capture()
        simulation.step(steps)
        end = simulation.state("robot")
    with scenario.start() as simulation:
        simulation.restore(state)
        simulation.step(steps)
        assert np.array_equal(simulation.state("robot"), end)
