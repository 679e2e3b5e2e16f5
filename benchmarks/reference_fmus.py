"""Runs three of the Reference FMUs of Modelica as models, and compares them with their reference results.

`python benchmarks/reference_fmus.py SOURCES FMUS...` takes a checkout of https://github.com/modelica/Reference-FMUs,
which has `BouncingBall/BouncingBall_out.csv` and so on, and folders of built FMUs (`cmake -DFMI_VERSION=2 .. && make`
puts them into `fmus/`). It prints the greatest difference of each variable, and ends with status 1 if one is above
1e-12.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import symaware_cli as sa

# isort: split
import numpy as np

#: For each FMU: time step and duration [s], and the variables that are elements of the state, with initial values.
MODELS: dict[str, tuple[float, float, dict[str, float]]] = {
    "BouncingBall": (0.01, 3.0, {"h": 1.0, "v": 0.0}),
    "Dahlquist": (0.1, 10.0, {"x": 1.0}),
    "Feedthrough": (0.1, 2.0, {"Float64_continuous_output": 0.0, "Int32_output": 0.0}),
}
#: What is fed to Feedthrough in a second run, from some times on [s].
FED = {0.0: [1.5, 3.0], 0.5: [-2.25, -7.0], 1.2: [1e-9, 2147483647.0]}


def run(folder: Path, fmu: Path, name: str, inputs: dict[str, Any] | None = None) -> sa.Series:
    """Run an FMU as the model of one agent, and return its states."""
    step, duration, variables = MODELS[name]
    shutil.copy(fmu, folder / fmu.name)
    model: dict[str, Any] = {
        "fmu": {"file": fmu.name},
        "state": {"east": {"unit": "m"}, "north": {"unit": "m"}, **{each: {"variable": each} for each in variables}},
        "position": ["east", "north"],
    }
    components = {}
    if inputs is not None:
        model["control_input"] = {each: {"variable": each} for each in inputs["variables"]}
        requested = [{"time": time, "input": values} for time, values in inputs["values"].items()]
        components = {"feed": {"use": "control.schedule", "with": {"inputs": requested}}}
    document = {
        "symaware": 1,
        "name": name.lower(),
        "run": {"duration": duration},
        "environment": {"use": "kinematic", "with": {"time_step": step}},
        "agents": {
            "unit": {
                "model": {"use": "fmu", "with": model},
                "state": [0.0, 0.0, *variables.values()],
                "components": components,
            }
        },
    }
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(document), encoding="utf-8")
    log = folder / f"{name}.mcap"
    sa.load(path, trust=True).run(output=log)
    return sa.open_log(log).series("unit", "world")


def at_instants(series: sa.Series, times: Any) -> Any:
    """Return the states at some times [s]; instants at which nothing changed are not in a log."""
    places = np.searchsorted(series.times, np.round(times * 1e9).astype(np.int64), side="right") - 1
    return series.values[places, 2:]


def main() -> int:
    """Compare all."""
    sources, *folders = map(Path, sys.argv[1:])
    worst = 0.0
    for folder in folders:
        for name, (_, _, variables) in MODELS.items():
            reference = np.genfromtxt(sources / name / f"{name}_out.csv", delimiter=",", names=True)
            with tempfile.TemporaryDirectory() as place:
                found = at_instants(run(Path(place), folder / f"{name}.fmu", name), reference["time"])
            expected = np.column_stack([reference[each] for each in variables])
            difference = float(np.abs(found - expected).max())
            worst = max(worst, difference)
            print(f"{folder}: {name}: {len(reference)} instants, {', '.join(variables)}: differ by {difference:.3g}")
        step, duration, variables = MODELS["Feedthrough"]
        fed = {"variables": ["Float64_continuous_input", "Int32_input"], "values": FED}
        with tempfile.TemporaryDirectory() as place:
            times = step * np.arange(1, round(duration / step) + 1)
            found = at_instants(run(Path(place), folder / "Feedthrough.fmu", "Feedthrough", fed), times)
        # An input counts for the step that begins when it is given, and its output is read after it.
        given = [[time for time in FED if time <= now - step + 1e-9][-1] for now in times]
        difference = float(np.abs(found - np.array([FED[time] for time in given])).max())
        worst = max(worst, difference)
        print(f"{folder}: Feedthrough: inputs and outputs differ by {difference:.3g}")
    return 0 if worst <= 1e-12 else 1


if __name__ == "__main__":
    sys.exit(main())
