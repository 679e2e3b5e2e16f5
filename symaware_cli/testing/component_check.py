"""Checks of components: purity, repeatability, declared events, finite values, state and batches."""

from __future__ import annotations

from typing import Any

from symaware_cli.core import (
    CommunicationReceiver,
    Component,
    Event,
    GroupCommunicationReceiver,
    GroupComponent,
)
from symaware_cli.core.component import may_wait
from symaware_cli.core.event import RECURRING
from symaware_cli.engine import Run
from symaware_cli.language import KINDS
from symaware_cli.testing.conformance import DeviationList, require_kind, unlike
from symaware_cli.testing.side_effects import fingerprint, group_state, own_state, watched
from symaware_cli.testing.small_scenario import (
    CHECKED,
    Changes,
    SmallScenario,
    batch_difference,
    check_run,
    report_failure,
    scenario,
    started,
    trace,
)
from symaware_cli.world import Quantity

_KIND = next(each for each in KINDS if each.name == "component")


def check_component(
    kind: type[Component | GroupComponent], changes: Changes | None = None, /, **parameters: Any
) -> None:
    """Check a component of single agents or of a group in a small scenario.

    Three unicycles with goals and a perception run for eight steps, with the component as the last of each. `_compute`
    must not change anything, nor draw from global generators or read the clock, and return the same value twice. All
    values must be finite, events declared, runs repeatable, and the state capturable. A component that declares
    ``batchable`` must compute the same in batches.

    Args:
        kind: The class.
        changes: Values of the scenario by their paths, such as ``{"agents.robot.count": 5}`` or
            ``{"agents.robot.model.use": MyModel}``; `use` may be a class.
        parameters: The parameters of the component.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    _check_declarations(found)
    found.settle()
    content = scenario()
    content["agents"]["robot"]["components"][CHECKED] = {"use": kind, "with": parameters}
    if may_wait(kind):
        content["run"]["mode"] = "asynchronous"
    small = SmallScenario(content, changes, found)
    with started(small.build(_observed(kind, found))) as run:
        _subscribe(run, found)
        trace(run)
        if run.failure is not None:
            report_failure(found, run.failure, "_update")
    found.settle()
    check_run(small, "_compute", with_state=not may_wait(kind))
    if not found and vars(kind).get("batchable") and issubclass(kind, GroupComponent):
        problem = batch_difference(small)
        if problem is not None:
            how = "let each row depend on its own run only, without sums across rows and BLAS, or omit `batchable`"
            found.add("batchable", f"is declared, but {problem}", how)
    found.settle()


def _check_declarations(found: DeviationList) -> None:
    kind = found.kind
    for name in ("events", "knowledge"):
        for key, meaning in getattr(kind, name).items():
            if not isinstance(meaning, str) or not meaning.strip():
                found.add(name, f"does not say what `{key}` means", f"{name} = {{{key!r}: 'its meaning'}}")
    for each in (*kind.signals, *kind.parts):  # type: ignore[attr-defined]
        for column in each.columns or ():
            if not isinstance(column, Quantity) or not column.name or not isinstance(column.unit, str):
                what = f"has a column of `{each.name}` without name and unit"
                found.add("signals" if each in kind.signals else "parts", what, 'Quantity("distance", "m")')  # type: ignore[attr-defined]


def _subscribe(run: Run, found: DeviationList) -> None:
    """Find events of the component that it does not declare."""
    paths = {each.path for entry in run.simulation.entries if entry.name == CHECKED for each in entry.components}
    paths |= {f"agents.{id}.{CHECKED}" for group in run.simulation.groups for id in group.ids}
    declared = {*found.kind.events, "failed", *RECURRING}  # type: ignore[attr-defined]

    def note(event: Event) -> None:
        if event.source in paths and event.name not in declared:
            found.add("emit", f"fires the event `{event.name}`, which `events` does not declare", _declaring(event))

    run.simulation.events.subscribe("*", note)


def _declaring(event: Event) -> str:
    return f"events = {{{event.name!r}: 'what it means'}}"


def _observed(kind: type, found: DeviationList) -> type:
    """Return a class derived from a component that observes its methods."""

    def _compute(self: Any) -> Any:
        value, before, fired = None, _everything(self), _Fired(self)
        with fired, watched(found, "_compute"):
            value = kind._compute(self)  # type: ignore[attr-defined]
        for name in fired.names:
            found.add("_compute", f"fires `{name}`, although its result may never count", "do that in `_update`")
        changed = unlike(before, _everything(self))
        # Receivers take messages from the inbox.
        if not isinstance(self, CommunicationReceiver | GroupCommunicationReceiver):
            if changed:
                found.add("_compute", f"changes {', '.join(changed)}", "return a value, and change it in `_update`")
            elif not may_wait(kind) and not fired.names:
                first = fingerprint(value)
                with _drawing_anew(self), watched(found, "_compute"):
                    again = fingerprint(kind._compute(self))  # type: ignore[attr-defined]
                if again != first:
                    what = "returns another value when it is called again at once"
                    found.add("_compute", what, "depend on the awareness, the parameters and `self.random` only")
        return value

    def _update(self: Any, value: Any) -> None:
        first = fingerprint(value)
        with watched(found, "_update"):
            kind._update(self, value)  # type: ignore[attr-defined]
        if fingerprint(value) != first and not isinstance(value, list):
            found.add("_update", "changes the value that it was given", "change a copy")

    owner = next(each for each in kind.__mro__ if "_update" in vars(each))
    return type(
        kind.__name__,
        (kind,),
        {
            "_compute": _compute,
            "_update": _update,
            "__doc__": kind.__doc__,
            "__module__": kind.__module__,
            # Which class explains a value of the wrong type depends on the one that defines `_update`.
            **({"misfit": kind.misfit} if "misfit" in vars(owner) else {}),  # type: ignore[attr-defined]
            **({"batchable": True} if vars(kind).get("batchable") else {}),
        },
    )


def _everything(component: Any) -> dict[str, str]:
    environment = component.environment
    states = {f"the world's {group.name}": fingerprint(environment.state(group)) for group in environment.groups}
    owner = component._group if isinstance(component, GroupComponent) else component._agent.group
    return {**own_state(component), **group_state(owner), **states}


class _drawing_anew:  # noqa: N801 # used like a function
    """Lets a component repeat the draws of its first call in a second call."""

    def __init__(self, component: Any) -> None:
        self._component = component

    def __enter__(self) -> None:
        self._chance = vars(self._component).pop("_random", None)

    def __exit__(self, *error: object) -> None:
        vars(self._component).pop("_random", None)
        if self._chance is not None:
            vars(self._component)["_random"] = self._chance


class _Fired:
    """Names of the events and messages of a component within a block."""

    def __init__(self, component: Any) -> None:
        self.names: dict[str, None] = {}
        self._component = component

    def __enter__(self) -> None:
        component = self._component
        emit, send = component._emit_from, getattr(component, "send", None)

        def noted(path: str, agent: str | None, name: str, *others: Any) -> None:
            self.names[name] = None
            emit(path, agent, name, *others)

        def sent(message: Any) -> None:
            self.names["a message"] = None
            if send is not None:
                send(message)

        vars(component)["_emit_from"] = noted
        if send is not None:
            vars(component)["send"] = sent

    def __exit__(self, *error: object) -> None:
        vars(self._component).pop("_emit_from", None)
        vars(self._component).pop("send", None)
