"""The small scenario in which plugins are checked: a few agents in a plane, with the plugin among them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

from symaware_cli.core.stateful import StateError
from symaware_cli.engine import Run, RunError, SimulationState, capture, restore
from symaware_cli.language import Problem, ScenarioError, Source, SourceNode, compose_content, dumped
from symaware_cli.language.build import Built, build_composition
from symaware_cli.plugin_files import register
from symaware_cli.studies import differing_compositions
from symaware_cli.testing.conformance import DeviationList, method_of
from symaware_cli.testing.side_effects import fingerprint, group_state

#: Values of the small scenario by their paths, such as ``{"agents.robot.count": 5}``.
Changes = Mapping[str, Any]

#: The name under which the plugin is checked: also its key among components and faults.
CHECKED = "checked"

#: Eight steps of three unicycles that cross a circle, each with a body and a goal.
_SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "conformance",
    "seed": 3,
    "run": {"duration": 0.4},
    "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
    "agents": {
        "robot": {
            "count": 3,
            "model": {"use": "unicycle"},
            "entity": {"shape": {"circle": {"radius": 0.25}}},
            "state": {"circle": {"radius": 2.0}},
            "knowledge": {"goal": {"circle": {"radius": 2.0, "phase": 3.0}}},
            "components": {
                "sense": {"use": "perception.omniscient"},
                "steer": {"use": "control.go-to-goal"},
            },
        }
    },
}


def scenario() -> dict[str, Any]:
    """Return a copy of the small scenario."""
    return deepcopy(_SCENARIO)


class SmallScenario:
    """A scenario with a plugin, which can be built any number of times.

    Attributes:
        content: The document; `use` may be a class.
        found: Receives the deviations of the plugin.
        is_named: Whether scenarios can name plugins of this kind.
    """

    def __init__(self, content: dict[str, Any], changes: Changes | None, found: DeviationList) -> None:
        self.content = content
        self.found = found
        self.is_named = True
        self._names: dict[str, None] = {}
        self._changes = {path: self._named(value) for path, value in (changes or {}).items()}

    def build(self, kind: type | None = None, seed: int | None = None) -> Built:
        """Build the scenario.

        Args:
            kind: A class in place of the one that is checked, such as one derived from it.
            seed: A seed in place of that of the scenario.

        Raises:
            ConformanceError: The scenario is invalid.
        """
        try:
            return build_composition(self.composition(kind), Path.cwd(), seed)
        except ScenarioError as error:
            how = 'give its parameters as keywords, and what else it needs like {"agents.robot.knowledge.goal": [1, 2]}'
            problems = ", and ".join(_described(each) for each in error.problems)
            self.found.add("", f"cannot be put into the scenario of the check: {problems}", how)
            self.found.settle()
            raise

    def composition(self, kind: type | None = None) -> Any:
        """Compose the document, in which classes are replaced by names."""
        if self.is_named:
            register(CHECKED, kind or self.found.kind)
            self._names[f"<{CHECKED}>"] = None
        plain = self._named(self.content)
        plain["plugins"] = list(self._names)
        text = dumped(plain)
        source = Source("the scenario of the check", text)
        root = SourceNode.of(plain, source.text_span(1, 1, 2, 0))
        return compose_content(root, source, {"conformance.yaml": text}, self._changes)

    def _named(self, value: Any) -> Any:
        if isinstance(value, type):
            if value is self.found.kind:
                return CHECKED
            name = f"{CHECKED}-{value.__name__.lower()}"
            register(name, value)
            self._names[f"<{name}>"] = None
            return name
        if isinstance(value, Mapping):
            return {key: self._named(each) for key, each in value.items()}
        return [self._named(each) for each in value] if isinstance(value, list | tuple) else value


def _described(problem: Problem) -> str:
    expected = f" (expected {problem.expected})" if problem.expected else ""
    return " ".join(f"{problem.message}{expected}".split())


@contextmanager
def started(built: Built) -> Iterator[Run]:
    """Begin a run without a log, which is ended after the block."""
    with built.simulation.environment:
        run = Run(built.simulation, built.steps, None, None, replace(built.options, may_exit=False))
        try:
            run.advance(0)
            yield run
        finally:
            run.leave("checked")


def world_state(run: Run) -> dict[str, str]:
    """Return a fingerprint of the true and believed states, the knowledge and the control inputs of a run."""
    found: dict[str, str] = {}
    for group in run.simulation.groups:
        found[f"the true state of {group.name}"] = fingerprint(run.simulation.environment.state(group))
        found |= {f"{name} of {group.name}": each for name, each in group_state(group).items()}
    return found


def trace(run: Run, steps: int | None = None) -> list[dict[str, str]]:
    """Make steps, until the end by default, and return `world_state` after each."""
    found: list[dict[str, str]] = []
    while run.status is None and (steps is None or len(found) < steps):
        run.advance(1)
        found.append(world_state(run))
    return found


def difference(one: list[dict[str, str]], other: list[dict[str, str]]) -> str | None:
    """Describe the first difference of two traces; None if they are equal."""
    for step, (first, second) in enumerate(zip(one, other, strict=False)):
        for name in first:
            if first[name] != second.get(name):
                return f"{name} differs after step {step + 1}"
    return None if len(one) == len(other) else f"one run has {len(one)} steps, the other {len(other)}"


def check_run(small: SmallScenario, where: str, *, with_state: bool = True) -> None:
    """Check that runs of a scenario succeed, are equal, and can be captured and restored.

    Args:
        small: The scenario.
        where: The method to name, if a difference cannot be attributed to another one.
        with_state: Whether the state is captured and restored.
    """
    found = small.found
    with started(small.build()) as run:
        first = trace(run)
        if run.failure is not None:
            report_failure(found, run.failure, where)
            return
    half, how = max(1, len(first) // 2), "keep its state in attributes, as plain data (docs/capture.md)"
    with started(small.build()) as run:
        begun = trace(run, half)
        try:
            state = _captured(run) if with_state and run.status is None else None
        except StateError as error:
            found.add("", f"has a state that cannot be captured: {error}", how)
            state = None
        differing = difference(first, begun + trace(run))
        if differing is not None:
            again = "use `self.random`, and neither the clock, the order of a set nor data of other runs"
            found.add(where, f"is not repeatable: in a second run with the same seed {differing}", again)
            return
        if state is not None:
            _check_restored(found, run, state, first[half:], where, "", how)
    if state is not None and not found:
        with started(small.build()) as run:
            _check_restored(found, run, state, first[half:], where, " in a fresh run", how)


def _captured(run: Run) -> SimulationState:
    return SimulationState.from_bytes(capture(run, CHECKED, "").to_bytes())


def _check_restored(
    found: DeviationList,
    run: Run,
    state: SimulationState,
    expected: list[dict[str, str]],
    where: str,
    words: str,
    how: str,
) -> None:
    try:
        restore(run, state, CHECKED, "")
    except StateError as error:
        found.add("", f"has a state that cannot be restored{words}: {error}", how)
        return
    again = difference(expected, trace(run))
    if again is not None:
        found.add(where, f"does not continue alike from a captured state{words}: {again}", how)


def report_failure(found: DeviationList, failure: RunError, where: str) -> None:
    """Add the failure of a run, by default as one of a method."""
    cause = failure.__cause__ or failure.__context__
    if "`_compute` returned" in failure.problem:
        found.add("_compute", failure.problem.removeprefix("TypeError: "))
    elif cause is not None:
        found.failure(method_of(found.kind, cause) or where, cause)
    else:
        what = f"fails the run at {failure.time / 1e9:g} s: {failure.problem}"
        found.add(where, what, "write finite values only")


def batch_difference(small: SmallScenario) -> str | None:
    """Describe the first run of a batch that differs from the same run alone; None if all are equal.

    The initial states are drawn, so that the runs differ.
    """
    group = next(each for each in small.build().simulation.groups if each.name == "robot")
    small.content["agents"]["robot"]["state"] = [{"uniform": [-2.0, 2.0]} for _ in group.model.state]
    return differing_compositions(small.build(), small.composition, Path.cwd(), sizes=(1, 3, 5))
