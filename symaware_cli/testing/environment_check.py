"""Checks of environments: states, applied inputs and snapshots, arrays that never change, sharing and batches."""

from __future__ import annotations

from typing import Any

import numpy as np

from symaware_cli.core import Environment
from symaware_cli.core.stateful import StateError
from symaware_cli.engine import Run
from symaware_cli.geometry import Array
from symaware_cli.language import KINDS
from symaware_cli.testing.conformance import DeviationList, require_kind
from symaware_cli.testing.side_effects import fingerprint, watched
from symaware_cli.testing.small_scenario import (
    Changes,
    SmallScenario,
    batch_difference,
    check_run,
    report_failure,
    scenario,
    started,
)

_KIND = next(each for each in KINDS if each.name == "environment")


def check_environment(kind: type[Environment], changes: Changes | None = None, /, **parameters: Any) -> None:
    """Check an environment with three agents that move for eight steps.

    The environment must begin with the initial states, advance by its time step, return finite arrays of the declared
    shapes, and never change an array that it has returned, nor the control inputs. Runs must be equal, also in batches
    if it is ``batchable``, and continue alike from a captured state, unless it raises a `StateError`.

    Args:
        kind: The class.
        changes: Values of the scenario by their paths, such as ``{"agents.robot.count": 5}``.
        parameters: The parameters of the environment.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    content = scenario()
    content["environment"] = {"use": kind, "with": {"time_step": 0.05, **parameters}}
    small = SmallScenario(content, changes, found)
    derived: Any = type(kind.__name__, (kind,), {"step": _observed_step(kind, found), **_same(kind)})
    with started(small.build(derived)) as run:
        _check_views(found, run, begun=True)
        while run.status is None and not found:
            _check_step(found, run)
        if run.failure is not None:
            report_failure(found, run.failure, "step")
    with found.calling("close"):
        run.simulation.environment.close()
    found.settle()
    check_run(small, "step", with_state=_captures(kind))
    if not found and vars(kind).get("batchable"):
        problem = batch_difference(small)
        if problem is not None:
            found.add("batchable", f"is declared, but {problem}", "let no agent act on those of other runs")
    found.settle()


def _same(kind: type) -> dict[str, Any]:
    names = {"__doc__": kind.__doc__, "__module__": kind.__module__}
    return names | ({"batchable": True} if vars(kind).get("batchable") else {})


def _captures(kind: type[Environment]) -> bool:
    """Whether worlds of a class can be captured, which physics engines refuse."""
    captured = getattr(kind, "captured", None)
    if captured is None:
        return True
    try:
        captured(kind.__new__(kind))
    except StateError:
        return False
    except Exception:
        return True
    return True


def _observed_step(kind: Any, found: DeviationList) -> Any:
    def step(self: Any) -> None:
        requested = [fingerprint(group.control_input) for group in self.groups]
        with watched(found, "step"):
            kind.step(self)
        if requested != [fingerprint(group.control_input) for group in self.groups]:
            found.add("step", "changes the control inputs that the groups request", "saturate copies of them")

    return step


def _check_step(found: DeviationList, run: Run) -> None:
    """Make a step, and check that it changes no array that was returned before."""
    environment = run.simulation.environment
    held: dict[str, Array] = {}
    for group in environment.groups:
        held["state"], held["applied_input"] = environment.state(group), environment.applied_input(group)
        held["snapshot"] = environment.snapshot().positions
    copies = {name: array.copy() for name, array in held.items()}
    run.advance(1)
    for name, array in held.items():
        if not np.array_equal(array, copies[name], equal_nan=True):
            found.add(name, "returned an array that a later step has changed", "create a new array at each step")
    if run.failure is None:
        _check_views(found, run)


def _check_views(found: DeviationList, run: Run, *, begun: bool = False) -> None:
    environment, now = run.simulation.environment, run.simulation.clock.now
    if not isinstance(environment.time_step, int) or environment.time_step <= 0:
        found.add("time_step", f"is {environment.time_step!r}", "call the inherited `__init__`: whole nanoseconds")
        return
    with found.calling("snapshot"):
        snapshot = environment.snapshot()
        if snapshot.time != now:
            what = f"is of {snapshot.time / 1e9:g} s at {now / 1e9:g} s of simulated time"
            found.add("snapshot", what, "advance its time by `time_step` in each step")
        if snapshot is not environment.snapshot():
            found.add("snapshot", "is another object for each caller", "keep it until the next step")
    for group in environment.groups:
        shapes = {"state": (len(group), len(group.model.state)), "applied_input": group.control_input.shape}
        for name, shape in shapes.items():
            with found.calling(name):
                array = getattr(environment, name)(group)
                if not isinstance(array, np.ndarray) or array.shape != shape:
                    found.add(name, f"returns the shape {np.shape(array)}", f"return an array of the shape {shape}")
                    continue
                if array.flags.writeable:
                    found.add(name, "returns an array that callers can change", "set `array.flags.writeable = False`")
                if not np.isfinite(array).all():
                    found.add(name, f"returns {array.tolist()} at {now / 1e9:g} s", "return finite numbers")
        if found:
            return
        start = run.simulation.environment.roster.start(group.name)
        places = snapshot.positions[start : start + len(group)]
        true = group.model.positions(environment.state(group))
        if not np.allclose(places[:, : true.shape[1]], true, atol=1e-6):
            found.add("snapshot", "has other positions than `state`", "take both from the same states")
        if begun and not np.allclose(environment.state(group), group.initial_state, atol=1e-3):
            found.add("initialise", "places agents elsewhere than in their `initial_state`", "begin with it")
        applied = environment.applied_input(group)
        if not begun and not np.array_equal(group.model.limit(applied), applied):
            found.add("applied_input", "is beyond the limits of the model", "return the inputs after saturation")
    if environment.is_shared:
        with found.calling("share"):
            environment.share()
