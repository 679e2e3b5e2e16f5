"""Components that subscribe when they begin hear each event once, whenever they begin, and also after a restore."""

from pathlib import Path
from typing import Any

import pytest

import symaware_cli as sa

SCENARIO = """\
symaware: 1
name: heard
plugins: [mine.py]
run: {duration: 1.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    count: 2
    model: {use: single-integrator}
    PRESENT
    components: {see: {use: perception.self}, count: {use: mine.Count}}
faults: {FAULTS}
"""

COUNT = '''\
from symaware_cli import Component


class Count(Component):
    """Counts the steps that it hears of."""

    def initialise_component(self, agent, awareness_database, knowledge_database):
        super().initialise_component(agent, awareness_database, knowledge_database)
        self.heard = 0
        self._surroundings.events.subscribe("stepped", self.hear)

    def hear(self, event):
        self.heard += 1

    def _compute(self):
        return self.heard

    def _update(self, value):
        pass


class Twice(Count):
    """Counts twice."""

    def hear(self, event):
        self.heard += 2
'''


def heard(folder: Path, present: str = "", faults: str = "{}", again: float | None = None) -> list[Any]:
    """What each agent has counted at the end; a run is rewound from the end to an instant first, if one is given."""
    (folder / "mine.py").write_text(COUNT)
    path = folder / "heard.yaml"
    path.write_text(SCENARIO.replace("PRESENT", present).replace("{FAULTS}", faults))
    with sa.load(path, trust=True).start() as simulation:
        if again is not None:
            if again:
                simulation.step(round(10 * again))
            state = simulation.capture()
            simulation.step(10 - round(10 * again))
            simulation.restore(state)
            simulation.step(10 - round(10 * again))
        else:
            simulation.step(10)
        (entry,) = [each for each in simulation._run.simulation.entries if each.name == "count"][:1]
        return [vars(component)["heard"] for component in entry.components]


def test_one_that_is_there_from_the_beginning_hears_every_step(tmp_path: Path) -> None:
    assert heard(tmp_path) == [10, 10]


def test_one_that_enters_later_hears_each_step_once(tmp_path: Path) -> None:
    assert heard(tmp_path, "present: [{from: 0.5}, {}]")[0] in (5, 6)


def test_one_that_begins_anew_hears_each_step_once(tmp_path: Path) -> None:
    assert heard(tmp_path, faults='{again: {restart: "robot.*.count", at: 0.5}}') == [5, 5]


@pytest.mark.parametrize("again", [0.0, 0.3, 0.6, 0.9])
@pytest.mark.parametrize(
    "faults",
    [
        "{}",
        '{again: {restart: "robot.*.count", at: 0.5}}',
        '{other: {replace: {use: mine.Twice, of: "robot.*.count"}, at: 0.2, for: 0.3}}',
    ],
)
def test_a_rewound_run_hears_what_an_uninterrupted_one_hears(tmp_path: Path, faults: str, again: float) -> None:
    assert heard(tmp_path, faults=faults, again=again) == heard(tmp_path, faults=faults)
