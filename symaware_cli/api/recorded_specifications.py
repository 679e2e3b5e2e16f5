"""The specifications of a log, with the values that its records give their predicates, instant by instant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from symaware_cli.api.recorded_run import RecordedRun
from symaware_cli.core import nanoseconds
from symaware_cli.environments.column_environment import RecordedEnvironment
from symaware_cli.recording.reader import open_log
from symaware_cli.runtime.event_router import EventRouter
from symaware_cli.runtime.run_summary import Observer
from symaware_cli.runtime.scope import WorldColumns, WorldScope
from symaware_cli.scenario.catalogue import Catalogue
from symaware_cli.scenario.files import open_scenario
from symaware_cli.specification.formulation import formulate
from symaware_cli.specification.node import Name, walk
from symaware_cli.specification.specification import Specification


class RecordedSpecifications:
    """A log that is replayed into a simulation of its scenario, and specifications about it.

    Attributes:
        log: The log.
        simulation: The simulation.
        options: The options of the run.
        specifications: What is to hold, with windows in steps of `period`.
        router: Connects the events of the log with what they bring about.
        observer: Watches the simulation, for what is said of the world.
        step: The time step of the world, in nanoseconds.
        period: The time between two instants, in nanoseconds: that of the recorded steps.
    """

    def __init__(
        self,
        path: Path,
        overrides: Sequence[str] = (),
        statements: Path | None = None,
        catalogue: Catalogue | None = None,
    ) -> None:
        """Open a log.

        Args:
            path: The log.
            overrides: Changes of its scenario.
            statements: A file of other specifications.
            catalogue: The installed plugins, if they were listed before.

        Raises:
            LogError: The log cannot be read.
            ScenarioError: A specification is invalid.
        """
        self.log = open_log(path)
        built = open_scenario(path, overrides, None, RecordedEnvironment, statements, catalogue)
        self.simulation, self.options = built.simulation, built.options
        recording = built.document.recording
        omitted = recording.omit
        self._left_out = {*omitted, *(("requested_control", "applied_control") if "control" in omitted else ())}
        stated: Sequence[Specification] = self.options.specifications
        self.step = self.simulation.environment.time_step
        self.period = max(1, -(-nanoseconds(recording.interval) // self.step)) * self.step
        if self.period != self.step:
            stated = [replace(each, formulation=formulate(each.formulation.tree, self.period)) for each in stated]
        self.specifications = stated
        self.router = EventRouter(self.simulation.events)
        self.observer = Observer(self.simulation)
        for each in stated:
            if isinstance(each.scope, WorldColumns):
                each.scope.source = WorldScope(self.simulation, self.observer)

    def instants(self) -> Iterator[int]:
        """Yield the recorded instants in nanoseconds, at each of which names have their recorded values.

        Raises:
            LogError: The log is damaged.
        """
        yield from RecordedRun(self.log, self.simulation).instants(self.period)

    def missing(self, specification: Specification) -> Sequence[str]:
        """Return which data that a specification needs the scenario leaves out of the log."""
        names = {node.name for node in walk(specification.formulation.tree) if isinstance(node, Name)}
        moving = {"closing_speed", "control_input", "speed", "velocity"}
        if specification.of == "belief":
            needed = {"state", *({"requested_control"} if names & moving else ())}
            needed |= {"awareness"} & {*map(_kind, names)}
            needed |= names & {"intent", "risk", "uncertainty"}
        else:
            needed = {"world", *({"requested_control", "applied_control"} if names & moving else ())}
        return sorted(needed & self._left_out)


def _kind(name: str) -> str:
    return "awareness" if name == "nearest" else name
