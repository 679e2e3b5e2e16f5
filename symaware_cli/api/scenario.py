"""Scenarios that are loaded, checked, run and stepped from Python.

Reasons: docs/decisions/0020-python-api.md
"""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from symaware_cli import processor
from symaware_cli.api.report import TextReport
from symaware_cli.api.result import RunResult, result_of
from symaware_cli.language import Changes, FilePath, assignments
from symaware_cli.world import counted, listed, record

if TYPE_CHECKING:
    from symaware_cli.api.stepping import SteppedSimulation
    from symaware_cli.core import Event
    from symaware_cli.knowledge import KnowledgeModel
    from symaware_cli.language import Assignment, Problem
    from symaware_cli.language.build import Built
    from symaware_cli.language.compose import Composition
    from symaware_cli.language.inline_scenario import InlineScenario
    from symaware_cli.processes import Place


@record
class GroupOutline:
    """One group of agents.

    Attributes:
        agents: Their ids, in the order of rows.
        model: The entry-point name of their model.
        components: The entry-point names of their components, by name, in the order of turns.
    """

    agents: Sequence[str]
    model: str
    components: Mapping[str, str]


@record
class Outline:
    """An overview of a valid scenario.

    Attributes:
        name: Its name.
        seed: The seed in force.
        mode: ``synchronous`` or ``asynchronous``.
        pace: Simulated seconds per second of wall time; None for as fast as possible.
        environment: The entry-point name of the world.
        entities: The other bodies in the world.
        groups: The groups of agents, by name.
        time_step: Simulated time between two steps [s].
        steps: The greatest number of steps.
        duration: Simulated time of these steps [s].
        digest: A digest of the scenario, in hexadecimal digits.
        warnings: Warnings about valid but probably unintended values; only `validate` looks for them.
    """

    name: str
    seed: int
    mode: str
    pace: float | None
    environment: str
    entities: Sequence[str]
    groups: Mapping[str, GroupOutline]
    time_step: float
    steps: int
    duration: float
    digest: str
    warnings: Sequence[Problem] = ()

    @property
    def agents(self) -> int:
        """The number of agents."""
        return sum(len(group.agents) for group in self.groups.values())

    @property
    def headline(self) -> str:
        """A summary in one line."""
        groups = counted(len(self.groups), "group")
        return f"{counted(self.agents, 'agent')} in {groups}, {self.steps:,} steps"

    @property
    def report(self) -> TextReport:
        """The outline for people."""
        pace = f", {self.pace:g} x real time" if self.pace else ""
        entities = f" with {listed(self.entities, 9)}" if self.entities else ""
        facts = [
            ("run", f"{self.duration:g} s in steps of {self.time_step:g} s, {self.mode}{pace}, seed {self.seed}"),
            ("environment", f"{self.environment}{entities}"),
        ]
        for name, group in self.groups.items():
            uses = listed((f"{component} ({use})" for component, use in group.components.items()), 9) or "no components"
            facts.append((name, f"{counted(len(group.agents), 'agent')}, {group.model}: {uses}"))
        return TextReport(f"{self.name}: {self.headline}", facts)


def outline(built: Built) -> Outline:
    """Return the outline of a valid scenario."""
    document, simulation = built.document, built.simulation
    time_step = simulation.environment.time_step
    return Outline(
        name=document.name,
        seed=document.seed,
        mode=document.run.mode,
        pace=document.run.pace,
        environment=document.environment.use,
        entities=tuple(document.environment.entities),
        groups={
            group.name: GroupOutline(group.ids, built.uses[group.name]["model"], built.uses[group.name]["components"])
            for group in simulation.groups
        },
        time_step=time_step / 1e9,
        steps=built.steps,
        duration=built.steps * time_step / 1e9,
        digest=built.digest.hex(),
    )


Mode = Literal["synchronous", "asynchronous"]

Subscribers: TypeAlias = "Callable[[Event], object] | Mapping[str, Callable[[Event], object]]"
"""A function that is called for all events, or functions by the names of events, in which ``*`` matches anything."""


def load(
    path: FilePath,
    changes: Changes | None = None,
    *,
    seed: int | None = None,
    trust: bool = False,
    plugins: Sequence[FilePath] = (),
) -> Scenario:
    """Read a scenario and check all of it.

    Args:
        path: A scenario in YAML or TOML, or a log that contains one.
        changes: Values that replace those of the file, by their paths, such as ``{"agents.robot.count": 8}``.
        seed: A seed that replaces the one of the scenario.
        trust: Whether to execute the Python files that the scenario names as `plugins`; otherwise they must be trusted
            already (`symaware trust`).
        plugins: Further such files, which are trusted; they are in the scenario's folder or below.

    Raises:
        ScenarioError: The scenario has problems; the text lists each with its place, like `symaware validate`.
        LogError: The log cannot be read, or contains no scenario.
    """
    scenario = Scenario(path, changes, seed=seed, trust=trust, plugins=plugins)
    scenario.outline = scenario.validate()
    return scenario


def scenario(content: Mapping[str, Any], changes: Changes | None = None, *, seed: int | None = None) -> Scenario:
    """Check a scenario that is written in Python.

    Args:
        content: The document, as in a file. `use` may also be a class, or a function of the state, the knowledge and
            the time (see `controller`). Files are relative to the current folder.
        changes: Values that replace those of the document.
        seed: A seed that replaces the one of the scenario.

    A class in a file of the current folder is loaded from that file and kept in the log, which can then be repeated
    alone. Others, such as those of a notebook, run as they are; `verify_log` says so if it needs them and they are not
    there.

    Raises:
        ScenarioError: The scenario has problems; each is located at the call.
        TypeError: A value has a type that scenarios do not support.
    """
    from symaware_cli.language.inline_scenario import InlineScenario, caller

    made = _ProgramScenario(InlineScenario(content, caller(1)), changes, seed)
    made.outline = made.validate()
    return made


class ScenarioBuilder:
    """Builds a checked scenario anew for each seed.

    Attributes:
        composition: The composed document; None if its files are read each time.
    """

    def __init__(self, build: Callable[[int | None], Built], composition: Composition | None = None) -> None:
        self._build = build
        self.composition = composition

    def __call__(self, seed: int | None) -> Built:
        """Build the scenario for a seed; None for its own."""
        return self._build(seed)


class Scenario:
    """A scenario file, with changes to it.

    Each run reads the file again, so an edit takes effect in the next run. `load` also checks the scenario.

    Attributes:
        path: The file.
        seed: The seed that replaces that of the file, if any.
        outline: The outline when it was loaded; None if it was not checked.
    """

    def __init__(
        self,
        path: FilePath,
        changes: Changes | None = None,
        *,
        seed: int | None = None,
        trust: bool = False,
        plugins: Sequence[FilePath] = (),
    ) -> None:
        self.path = Path(path)
        self._trust = trust
        self._plugins = tuple(map(Path, plugins))
        self._changes = assignments(changes)
        self.seed = seed
        self.outline: Outline | None = None

    @property
    def changes(self) -> tuple[str, ...]:
        """Changes of values of the file, as ``path=value``."""
        return tuple(map(str, self._changes))

    def validate(
        self,
        changes: Changes | None = None,
        *,
        seed: int | None = None,
        mode: Mode | None = None,
        duration: float | None = None,
        pace: float | None = None,
    ) -> Outline:
        """Check the scenario in its present form, without running it; for the arguments, see `run`.

        Raises:
            ScenarioError: It has problems.
            LogError: The log cannot be read, or contains no scenario.
        """
        built = self._build(changes, seed, mode, duration, pace)
        with built.simulation.environment:
            return replace(outline(built), warnings=tuple(built.find_warnings()))

    def knowledge_models(self) -> Mapping[str, KnowledgeModel]:
        """Return the knowledge models of the scenario in its present form, by name.

        Raises:
            ScenarioError: It has problems.
            LogError: The log cannot be read, or contains no scenario.
        """
        from symaware_cli.knowledge import KnowledgeModel

        models = self._build(None, None, None, None, None).sections.get("knowledge_models", {})
        return {name: each for name, each in models.items() if isinstance(each, KnowledgeModel)}

    def run(
        self,
        changes: Changes | None = None,
        *,
        seed: int | None = None,
        mode: Mode | None = None,
        duration: float | None = None,
        pace: float | None = None,
        output: FilePath | None = None,
        record: bool = True,
        timeout: float | None = None,
        progress: bool | Callable[[float], object] = False,
        on_event: Subscribers | None = None,
        live: bool | str = False,
        place: Place | None = None,
        may_exit: bool = False,
        on_warnings: Callable[[Sequence[Problem]], object] | None = None,
    ) -> RunResult:
        """Run the scenario to its end.

        Args:
            changes: Further values that replace those of the file, for this run.
            seed: A seed that replaces all others.
            mode: Replaces ``run.mode`` of the scenario.
            duration: Replaces ``run.duration`` [s].
            pace: Replaces ``run.pace``: simulated seconds per second of wall time, or infinity for as fast as possible.
            output: The path of the log; replaced if it exists. By default NAME.mcap, or NAME-2.mcap and so on, in the
                current folder.
            record: Whether to write a log.
            timeout: Wall time after which the run is ended with the status ``interrupted`` and its log finished [s].
            progress: True to show a bar, on the terminal or in a notebook; or a function that is called from time to
                time with the present simulated time [s].
            on_event: Called with each event, including those of every step, turn and message; or functions by event
                names, in which ``*`` matches anything, which cost less time.
            live: True to show the run in a viewer while it is running, or the URL of a running viewer.
            place: The role of this process in a run of several: `Place.host` or `Place.member`.
            may_exit: Whether the process may exit, like a command, if the run reacts neither to a second Ctrl-C nor to
                its time-out. Otherwise a second Ctrl-C ends the run immediately, even within the record of an instant.
            on_warnings: Called before the run begins with the warnings of `validate`, if there are any. None to skip
                the search for them.

        Raises:
            ScenarioError: The scenario has problems; no log was written.
            RunFailedError: A component or the environment failed. The log is finished.
            RunInterrupted: Ctrl-C or SIGTERM ended the run. The log is finished.
            LogError: The log cannot be written, or it would replace a file of the scenario.
            DistributionError: This process cannot have the requested role.
            TransportError: The other processes cannot be reached.

        Warns:
            ProcessorWarning: The run may differ in its last bits on another processor.
        """
        from symaware_cli.api.progress import progress as bar
        from symaware_cli.language import prepared

        built = self._build(changes, seed, mode, duration, pace)
        processor.warn_once(stacklevel=2)
        viewer = None
        with ExitStack() as stack:
            stack.enter_context(built.simulation.environment)
            log = self._log(built, output) if record else None
            if on_warnings is not None and (found := built.find_warnings()):
                on_warnings(found)
            if live:
                from symaware_cli.api.live import LiveView

                viewer = LiveView(log, live if isinstance(live, str) else None)
                stack.callback(viewer.close)
            _subscribe(built, on_event)
            end = built.steps * built.simulation.environment.time_step
            with bar(built.document.name, 0, end, progress is True) as shown:
                told = _in_seconds(progress) if callable(progress) else shown
                path = viewer.path if viewer else log
                with prepared(built, path, told, timeout, place, may_exit) as run:
                    run.advance()
            # The run is over, but the viewer may stay open.
            stack.pop_all()
        return result_of(run, viewer, recorded=record)

    def start(
        self,
        changes: Changes | None = None,
        *,
        seed: int | None = None,
        mode: Mode | None = None,
        duration: float | None = None,
        pace: float | None = None,
        output: FilePath | None = None,
        on_event: Subscribers | None = None,
        within_steps: bool = False,
    ) -> SteppedSimulation:
        """Start the scenario for stepping; use it in a ``with`` statement, which finishes the log.

        Args:
            changes: See `run`.
            seed: See `run`.
            mode: See `run`.
            duration: See `run`.
            pace: See `run`; time between two steps is included.
            output: The path of the log; replaced if it exists. By default there is no log.
            on_event: See `run`.
            within_steps: Whether each call of `step` ends within a step, after the turns of all components, instead of
                before them: beliefs are then those of the present instant, and `set_control` acts at this instant. The
                first call makes no whole step.

        Raises:
            ScenarioError: The scenario has problems.
            RunFailedError: A component failed during its initialisation.
            LogError: The log cannot be written, or it would replace a file of the scenario.

        Warns:
            ProcessorWarning: See `run`.
        """
        from symaware_cli.api.stepping import SteppedSimulation

        built = self._build(changes, seed, mode, duration, pace)
        processor.warn_once(stacklevel=2)
        with ExitStack() as stack:
            stack.enter_context(built.simulation.environment)
            log = None if output is None else self._log(built, output)
            _subscribe(built, on_event)
            simulation = SteppedSimulation(built, log, within_steps)
            stack.pop_all()
        return simulation

    def builder(self, changes: Changes | None = None) -> ScenarioBuilder:
        """Check the scenario in its present form, and return what builds it anew for a seed.

        The files are read once, if no file of plugins beside the scenario has to be trusted each time.

        Raises:
            ScenarioError: It has problems.
            LogError: The log cannot be read, or contains no scenario.
        """
        built = self._build(changes, None, None, None, None)
        if type(self) is not Scenario or built.document.plugins or self.path.suffix == ".mcap":
            return ScenarioBuilder(lambda seed: self._build(changes, seed, None, None, None))
        from symaware_cli.language import Catalogue
        from symaware_cli.language.build import build_composition
        from symaware_cli.language.compose import compose

        composition, catalogue = compose(self.path, [*self._changes, *assignments(changes)]), Catalogue()
        own = self.seed

        def build(seed: int | None) -> Built:
            return build_composition(composition.copy(), self.path.parent, own if seed is None else seed, catalogue)

        return ScenarioBuilder(build, composition)

    def _build(
        self, changes: Changes | None, seed: int | None, mode: Mode | None, duration: float | None, pace: float | None
    ) -> Built:
        asked: dict[str, Any] = {"run.mode": mode, "run.duration": duration, "run.pace": pace}
        options = {path: value for path, value in asked.items() if value is not None}
        if pace == math.inf:
            options["run.pace"] = None
        with ExitStack() as stack:
            changed = [*self._changes, *assignments(changes), *assignments(options)]
            if self._trust or self._plugins:
                from symaware_cli.language import add_plugins
                from symaware_cli.plugin_files import trusting

                own = add_plugins(self.path, self._plugins, changed)
                stack.enter_context(trusting(lambda files: self._trust or own.issuperset(files.named)))
            built = self._open(changed, self.seed if seed is None else seed)
        if built.options.turn_limit is not None and threading.current_thread() is not threading.main_thread():
            warnings.warn("`run.turn_limit` holds in the main thread only", RuntimeWarning, stacklevel=3)
        return built

    def _open(self, changes: Sequence[Assignment], seed: int | None) -> Built:
        from symaware_cli.language import open_scenario

        return open_scenario(self.path, changes, seed)

    def _log(self, built: Built, output: FilePath | None) -> Path:
        """Return the path of the log of a run."""
        from symaware_cli.language import check_output, unused_path

        if output is None:
            return unused_path(built.document.name)
        check_output(built, Path(output), self.path)
        return Path(output)

    def __repr__(self) -> str:
        changes = "".join(f", {change}" for change in self.changes)
        seed = "" if self.seed is None else f", seed={self.seed}"
        found = f": {self.outline.headline}" if self.outline else ""
        return f"<Scenario {self.path}{changes}{seed}{found}>"

    def __str__(self) -> str:
        return self.outline.report.text if self.outline else repr(self)

    def _repr_html_(self) -> str | None:
        return self.outline.report.html if self.outline else None


class _ProgramScenario(Scenario):
    """A scenario that a program wrote as a mapping."""

    def __init__(self, content: InlineScenario, changes: Changes | None, seed: int | None) -> None:
        super().__init__(content.place, changes, seed=seed)
        self._content = content

    def _open(self, changes: Sequence[Assignment], seed: int | None) -> Built:
        return self._content.build(changes, seed)


def _subscribe(built: Built, subscribers: Subscribers | None) -> None:
    """Subscribe functions to the events of a run."""
    by_pattern = {"*": subscribers} if callable(subscribers) else subscribers or {}
    for pattern, call in by_pattern.items():
        built.simulation.events.subscribe_matching(pattern, call)


def _in_seconds(call: Callable[[float], object]) -> Callable[[int], None]:
    def tell(now: int) -> None:
        call(now / 1e9)

    return tell
