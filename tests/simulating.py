"""A simulation put together from classes, without a scenario file."""

from __future__ import annotations

import importlib
import inspect
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextvars import copy_context
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from symaware_cli import Entity, Environment, Model, Obstacle
from symaware_cli.core import AgentGroup, Component, Contact, GroupComponent
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.engine.runtime.timing import STEADY, Timing
from symaware_cli.log.manifest import manifest_of
from symaware_cli.log.recorder import Recorder
from symaware_cli.log.writer import LogWriter
from symaware_cli.world.plugin import Plugin

if TYPE_CHECKING:
    from typer.testing import Result

COMMAND = (sys.executable, "-P", "-m", "symaware_cli")
"""The command line of `symaware` in a separate process; -P, so that no folder shadows the installed package."""

OF_FILES = "symaware_cli.plugin_files.of_"
"""How the names of the modules of plugins in files begin."""

Command = Callable[..., subprocess.CompletedProcess[str]]
"""The type of the fixture `command`."""

STEP = 50_000_000
"""The time step of `simulation`, ns."""

Value = TypeVar("Value")
Plugged = TypeVar("Plugged", bound=Plugin)


def made(kind: type[Plugged], **parameters: Any) -> Plugged:
    """A plugin of a class, with parameters."""
    return kind(kind.Parameters(**parameters))


def invoked(*arguments: object, site: Path | None = None) -> Result:
    """Run `symaware ARGUMENTS` within this process, which forgets after it what would have ended with another process.

    These are the environment variables and the trust that the command handed down, the search path, the filters of
    warnings, the handlers of signals, and the modules of plugins that it imported: those of files, and those of `site`.

    Args:
        arguments: The arguments of the command.
        site: A folder with packages that are installed for this command.
    """
    from typer.testing import CliRunner

    from symaware_cli.cli.application import application

    # Versions of click before 8.2 mix both streams unless they are told not to, and later ones cannot be told.
    mixes = "mix_stderr" in inspect.signature(CliRunner).parameters
    streams: dict[str, Any] = {"mix_stderr": False} if mixes else {}
    runner = CliRunner(**streams)
    line = [str(argument) for argument in arguments]
    # Another test may have imported what has the same names.
    own = set() if site is None else {each.stem for each in site.iterdir()}
    aside = {name: sys.modules.pop(name) for name in list(sys.modules) if name.partition(".")[0] in own}
    variables, path, modules = dict(os.environ), list(sys.path), set(sys.modules)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        if site is not None:
            sys.path.insert(0, str(site))
            os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(site), variables.get("PYTHONPATH")]))
            importlib.invalidate_caches()
        with warnings.catch_warnings():
            result = copy_context().run(runner.invoke, application, line, prog_name="symaware")
    finally:
        sys.path[:] = path
        for name in os.environ.keys() - variables.keys():
            del os.environ[name]
        os.environ.update(variables)
        for name in sys.modules.keys() - modules:
            file = getattr(sys.modules[name], "__file__", None)
            if name.startswith(OF_FILES) or (site is not None and file and Path(file).is_relative_to(site)):
                del sys.modules[name]
        sys.modules.update(aside)
        for number, handler in handlers.items():
            if signal.getsignal(number) is not handler:
                signal.signal(number, handler)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def in_process(*arguments: object, site: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Do the same, and return what `subprocess.run` would."""
    result = invoked(*arguments, site=site)
    return subprocess.CompletedProcess(
        ["symaware", *map(str, arguments)], result.exit_code, result.stdout, result.stderr
    )


def untyped(value: object) -> Any:
    """Return a value without its static type, for attributes of its class that the type lacks."""
    return value


def present(value: Value | None) -> Value:
    """Return a value that is optional elsewhere, but not None here."""
    assert value is not None
    return value


@dataclass
class Team:
    """The definition of a group: the number of agents, and the factories and timing of their components."""

    components: Mapping[str, Callable[[], Component | GroupComponent]] = field(default_factory=dict)
    count: int | None = None
    state: Sequence[Sequence[float]] | None = None
    knowledge: Sequence[Mapping[str, object]] = ()
    model: Model = field(default_factory=SingleIntegrator)
    entity: Entity = field(default_factory=Entity)
    timings: Mapping[str, Timing] = field(default_factory=dict)

    def group(self, name: str) -> AgentGroup:
        ids = [name] if self.count is None else [f"{name}.{row}" for row in range(self.count)]
        state = self.state or [[float(row), *[0.0] * (len(self.model.state) - 1)] for row in range(len(ids))]
        return AgentGroup(name, ids, self.model, self.entity, state, self.knowledge)

    def entries(self, group: AgentGroup) -> list[ComponentEntry]:
        entries = []
        for name, make in self.components.items():
            first = make()
            others = [] if isinstance(first, GroupComponent) else [make() for _ in group.ids[1:]]
            group.awareness.declare({signal.field(name): signal for signal in first.signals})
            timing = self.timings.get(name, STEADY)
            components: Any = [first, *others]  # all of the class of the first
            entries.append(ComponentEntry(group, name, f"test.{name}", components, timing))
        return entries


def simulation(
    teams: Mapping[str, Team],
    *,
    environment: Environment | None = None,
    obstacles: Mapping[str, Obstacle] | None = None,
    seed: int = 7,
) -> Simulation:
    """Put teams into a world."""
    groups = {name: team.group(name) for name, team in teams.items()}
    return Simulation(
        name="test",
        seed=seed,
        environment=environment or KinematicEnvironment(KinematicEnvironment.Parameters(time_step=STEP / 1e9)),
        environment_use="test-world",
        groups=list(groups.values()),
        entries=[entry for name, team in teams.items() for entry in team.entries(groups[name])],
        obstacles=obstacles or {},
    )


def simulate(
    teams: Mapping[str, Team],
    steps: int = 3,
    log: Path | None = None,
    options: RunOptions | None = None,
    **more: Any,
) -> RunSummary:
    """Put teams into a world and let it run, with a log if there is a path for it."""
    return execute(simulation(teams, **more), steps, log, options)


def execute(ready: Simulation, steps: int, log: Path | None = None, options: RunOptions | None = None) -> RunSummary:
    """Let a simulation run, with a log if there is a path for it."""
    if log is None:
        return run(ready, steps, options=options)
    with LogWriter(log) as writer:
        content = manifest_of(
            name=ready.name,
            seed=ready.seed,
            mode="synchronous",
            steps=steps,
            environment=ready.environment,
            groups=ready.groups,
            uses={group.name: {"model": "test", "components": {}} for group in ready.groups},
            indexed={group.name: True for group in ready.groups},
        )
        writer.attach("manifest.json", "application/json", content)
        return run(ready, steps, Recorder(writer, ready.environment, ready.groups), options=options)


def moved(environment: Environment, time: float) -> list[Contact]:
    """Let a world move for a while [s]; the contacts that began or ended in it, and before."""
    contacts = list(environment.contacts())
    for _ in range(round(time * 1e9 / environment.time_step)):
        environment.step()
        contacts += environment.contacts()
    return contacts
