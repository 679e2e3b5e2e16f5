"""Checks that agents that go from cell to cell surely keep to their two cells, and come to the next one.

docs/decisions/0051-certified-cells.md has the proof whose premises are checked here.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symaware_cli.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.core import AgentGroup, Environment, WorldError, seconds
from symaware_cli.geometry.pieces import Pieces, separation
from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.scenario.diagnosis import Diagnosis
from symaware_cli.scenario.document import ScenarioDocument
from symaware_cli.scenario.problem import quoted

#: The controller that is checked; to import its class would slow down every run.
_CONTROLLER = "control.cells"

#: Perceptions that give agents their own state, exactly unless one of these parameters is not 0.
_PERCEPTIONS = {"perception.omniscient": (), "perception.self": (), "perception.range": ("self_noise", "delay")}

_OTHERWISE = "or `certified: false`"


def check_cells(
    document: ScenarioDocument, environment: Environment, entries: Sequence[ComponentEntry], diagnosis: Diagnosis
) -> None:
    """Report whatever makes it uncertain that an agent keeps to its cells.

    Args:
        document: The validated document.
        environment: The environment, initialised.
        entries: All component entries.
        diagnosis: Takes problems.
    """
    for entry in entries:
        if entry.use == _CONTROLLER and entry.components[0].parameters.certified:
            _CellCheck(document, environment, entry, diagnosis).check(
                [each for each in entries if each.group is entry.group]
            )


class _CellCheck:
    """Checks one controller."""

    def __init__(
        self, document: ScenarioDocument, environment: Environment, entry: ComponentEntry, diagnosis: Diagnosis
    ) -> None:
        self._key_path = partial(document.key_path, entry.section)
        self._environment = environment
        self._entry = entry
        self._report = diagnosis.report
        self._path = entry.section
        self._step = environment.time_step
        #: Time between two turns [ns].
        self._period = self._step if entry.timing.period is None else entry.timing.period

    def check(self, own: Sequence[ComponentEntry]) -> None:
        """Check the controller among all entries of its group."""
        self._check_turns()
        self._check_perception(own)
        for each in own[own.index(self._entry) + 1 :]:
            if each.use.startswith("control."):
                said = "changes the control input as well"
                self._uncertain(f"{quoted(each.name)} {said}", (*self._path[:3], each.name), "one controller")
        try:
            drive = self._environment.drive(self._entry.group)
        except WorldError as error:
            self._uncertain(str(error), error.path, "nothing else that moves it")
            return
        if drive.collides:
            self._check_contacts()

    def _uncertain(self, why: str, path: Sequence[str | int], expected: str) -> None:
        said = f"it is not certain that {quoted(self._entry.group.name)} keeps to its cells: {why}"
        self._report("uncertain", said, tuple(path), key=True, expected=f"{expected}, {_OTHERWISE}")

    def _check_turns(self) -> None:
        """Check that the turns are at each step of the world, or at each of a number of steps."""
        timing, step = self._entry.timing, seconds(self._step)
        for key, is_wrong, why in (
            ("jitter", timing.jitter > 0, "the time for which an input is held varies"),
            ("trigger", timing.trigger is not None, "an input is held until an event"),
            ("condition", timing.condition is not None, "an input is held while the condition does not hold"),
            ("latency", not timing.latency.is_zero, "an input is for where the agent was when it was computed"),
        ):
            if is_wrong:
                self._uncertain(why, self._key_path(key), f"no {key}")
        for key, value in (("period", self._period), ("offset", timing.offset)):
            if value % self._step or (key == "period" and not value):
                why = (
                    f"{'an input' if key == 'period' else 'the first'} is held for a part of a time step of {step:g} s"
                )
                self._uncertain(why, self._key_path(key), f"a whole multiple of {step:g} [s]")

    def _check_perception(self, own: Sequence[ComponentEntry]) -> None:
        """Check that the agent knows its own state exactly at each turn."""
        before = own[: own.index(self._entry)]
        exact = [each for each in before if self._is_exact(each)]
        if not exact:
            why = "it does not perceive its own exact state before each of its turns"
            sensing = next((each.name for each in before if each.use.startswith("perception.")), self._entry.name)
            expected = "`perception.self` or `perception.omniscient`, at each step, before it"
            self._uncertain(why, (*self._path[:3], sensing), expected)
            return
        for each in own:
            if _errs(each) or each.use.startswith("uncertainty."):
                why = f"{quoted(each.name)} may replace its exact state by an estimate"
                self._uncertain(why, (*self._path[:3], each.name), "exact perception alone")

    def _is_exact(self, entry: ComponentEntry) -> bool:
        """Whether a component gives an agent its exact state before each turn of the controller."""
        timing, step = entry.timing, self._step
        if entry.use not in _PERCEPTIONS or _errs(entry) or not timing.latency.is_zero:
            return False
        if timing.jitter or timing.trigger is not None or timing.condition is not None:
            return False
        if timing.is_steady(step):
            return True
        period = timing.period
        return (
            period is not None
            and period > 0
            and self._period % period == 0
            and (self._entry.timing.offset - timing.offset) % period == 0
        )

    def _check_contacts(self) -> None:
        """Check that no other body can touch the agent."""
        group, given = self._entry.group, self._entry.components[0].parameters
        where = (*self._path, "with", "apart_from") if given.apart_from else self._path
        if len(group.model.position) > 2:
            self._uncertain(
                "a body in space may touch the ground", ("agents", group.name, "model"), "a model in a plane"
            )
        excluded = {*self._excluded(given.apart_from)}
        others = sorted({*self._movers(group)} - excluded)
        if others:
            why = f"{_listed(others)} might touch it, and a contact diverts a body"
            self._uncertain(why, where, "the name in `apart_from`, if the strategy or anything else keeps them apart")
        model = group.knowledge_models[given.model]
        assert isinstance(model, KnowledgeModel)
        for name, cell, gap in self._near(group, model, excluded):
            radius = group.entity.radius
            why = (
                f"{quoted(name)} is {max(gap, 0.0):.3g} m from the cell {quoted(cell)}, and the body reaches "
                f"{radius:.3g} m from its position"
            )
            expected = f"cells {radius:.3g} m from it (`margin` of {quoted(given.model)}), a smaller body"
            self._uncertain(why, ("environment", "entities", name), expected)

    def _excluded(self, patterns: Sequence[str]) -> Iterator[str]:
        """Yield the bodies that are known to keep apart."""
        groups = {id: group.name for group in self._environment.groups for id in group.ids}
        for name in (*groups, *self._environment.obstacles):
            named = {name, groups.get(name, name)}
            if any(fnmatch.fnmatchcase(each, pattern) for each in named for pattern in patterns):
                yield name

    def _movers(self, own: AgentGroup) -> Iterator[str]:
        """Yield the other bodies that move."""
        for group in self._environment.groups:
            if group.entity.shape is not None and (group is not own or len(group) > 1):
                yield from group.ids
        for name, obstacle in self._environment.obstacles.items():
            if self._environment.moves(name) or obstacle.shape.urdf:
                yield name

    def _near(
        self, group: AgentGroup, model: KnowledgeModel, excluded: Collection[str]
    ) -> Iterator[tuple[str, str, float]]:
        """Yield each fixed body that the agent might touch, with the nearest cell and the distance of both [m]."""
        scenery, radius = self._environment.scenery, group.entity.radius
        apart = {*excluded, *self._movers(group)}
        boxes = Pieces.of((_corners(each), 0.0) for each in model.bounds)
        count = len(model.bounds)
        for number, name in enumerate(scenery.names):
            if name in apart:
                continue
            rows = np.flatnonzero(scenery.owner == number)
            pieces = scenery.pieces.take(np.repeat(rows, count))
            gaps = separation(boxes.take(np.tile(np.arange(count), len(rows))), pieces).distance
            nearest = int(gaps.argmin())
            if gaps[nearest] <= radius:
                yield name, model.system.states[nearest % count], float(gaps[nearest])


def _errs(entry: ComponentEntry) -> bool:
    """Whether a component perceives the agent's own state with errors, or late."""
    parameters = entry.components[0].parameters
    return any(np.any(getattr(parameters, name)) for name in _PERCEPTIONS.get(entry.use, ()))


def _corners(bounds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of a box, counter-clockwise; (2, 2) to (4, 2)."""
    (left, right), (low, high) = bounds.tolist()
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def _listed(names: Sequence[str]) -> str:
    shown = [quoted(each) for each in names[:3]]
    return ", ".join(shown) + (f" and {len(names) - 3} others" if len(names) > 3 else "")
