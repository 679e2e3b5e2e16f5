"""Checks that agents certainly stay within their present and next cell, and reach the next one.

docs/decisions/0051-certified-cells.md has the proof whose premises are checked here.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, EntryView, ScenarioView, WorldError, seconds
from symaware_cli.engine import errs, gives_exact_state
from symaware_cli.geometry import Pieces, separation
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel, model_named

_OTHERWISE = "or `certified: false`"


class CellCheck:
    """Checks a controller that goes from cell to cell; the environment has to be initialised."""

    def __init__(self, view: ScenarioView) -> None:
        assert view.entry is not None
        self._view = view
        self._entry = view.entry
        self._environment = view.environment
        self._step = self._environment.time_step
        #: Time between two turns [ns].
        self._period = self._step if view.entry.timing.period is None else view.entry.timing.period

    def check(self) -> None:
        """Report each reason why an agent might leave its cells."""
        self._check_turns()
        self._check_perception()
        for each in self._view.after:
            if each.use.startswith("control."):
                said = f"`{each.name}` changes the control input as well"
                self._uncertain(said, (), "one controller", section=each.section)
        try:
            drive = self._environment.drive(self._entry.group)
        except WorldError as error:
            self._uncertain(str(error), (), "nothing else that moves it", section=error.path)
            return
        if drive.collides:
            self._check_contacts()

    def _uncertain(
        self, why: str, place: Sequence[str], expected: str, section: tuple[str | int, ...] | None = None
    ) -> None:
        said = f"it is not certain that `{self._entry.group.name}` keeps to its cells: {why}"
        self._view.report(said, *place, section=section, code="uncertain", expected=f"{expected}, {_OTHERWISE}")

    def _check_turns(self) -> None:
        """Check that there is a turn at each step of the world, or at every k-th."""
        timing, step = self._entry.timing, seconds(self._step)
        for key, is_wrong, why in (
            ("jitter", timing.jitter > 0, "the time for which an input is held varies"),
            ("trigger", timing.trigger is not None, "an input is held until an event"),
            ("condition", timing.condition is not None, "an input is held while the condition does not hold"),
            ("latency", not timing.latency.is_zero, "an input is for where the agent was when it was computed"),
        ):
            if is_wrong:
                self._uncertain(why, (key,), f"no {key}")
        for key, value in (("period", self._period), ("offset", timing.offset)):
            if value % self._step or (key == "period" and not value):
                why = (
                    f"{'an input' if key == 'period' else 'the first'} is held for a part of a time step of {step:g} s"
                )
                self._uncertain(why, (key,), f"a whole multiple of {step:g} [s]")

    def _check_perception(self) -> None:
        """Check that the agent knows its own state exactly at each turn."""
        before = self._view.before
        if not any(gives_exact_state(each, self._entry, self._step) for each in before):
            why = "it does not perceive its own exact state before each of its turns"
            sensing = next((each for each in before if _senses(each)), self._entry)
            expected = "`perception.self` or `perception.omniscient`, at each step, before it"
            self._uncertain(why, (), expected, section=sensing.section)
            return
        for each in self._view.own_entries:
            if errs(each) or each.use.startswith("uncertainty."):
                why = f"`{each.name}` may replace its exact state by an estimate"
                self._uncertain(why, (), "exact perception alone", section=each.section)

    def _check_contacts(self) -> None:
        """Check that no other body can touch the agent."""
        group, given = self._entry.group, self._entry.components[0].parameters
        if len(group.model.position) > 2:
            self._uncertain(
                "a body in space may touch the ground",
                (),
                "a model in a plane",
                section=("agents", group.name, "model"),
            )
        excluded = {*self._excluded(given.apart_from)}
        others = sorted({*self._movers(group)} - excluded)
        if others:
            why = f"{_listed(others)} might touch it, and a contact diverts a body"
            self._uncertain(
                why,
                ("with", "apart_from"),
                "the name in `apart_from`, if the strategy or anything else keeps them apart",
            )
        model = model_named(given.model, group)
        for name, cell, gap in self._near(group, model, excluded):
            radius = group.entity.radius
            why = (
                f"`{name}` is {max(gap, 0.0):.3g} m from the cell `{cell}`, and the body reaches "
                f"{radius:.3g} m from its position"
            )
            expected = f"cells {radius:.3g} m from it (`margin` of `{given.model}`), a smaller body"
            self._uncertain(why, (), expected, section=("environment", "entities", name))

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
            if self._environment.moves(name) or obstacle.shape.robot:
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


def _senses(entry: EntryView) -> bool:
    return bool(entry.components[0].perceives()) or entry.use.startswith("perception.")


def _corners(bounds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of a box, counter-clockwise; (2, 2) to (4, 2)."""
    (left, right), (low, high) = bounds.tolist()
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def _listed(names: Sequence[str]) -> str:
    shown = [f"`{each}`" for each in names[:3]]
    return ", ".join(shown) + (f" and {len(names) - 3} others" if len(names) > 3 else "")
