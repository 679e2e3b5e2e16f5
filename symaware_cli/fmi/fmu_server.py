"""Runs the instances of an FMU in a separate process, so that its code cannot harm the run.

Requests and answers are JSON, so that answers of the process are never executed.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO

from symaware_cli.fmi.fmu_archive import FmuError, extract
from symaware_cli.world import read, write

#: The types of variables that are numbers.
NUMERIC = (
    *("Real", "Integer", "Boolean", "Float32", "Float64"),
    *("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32"),
)
_FLOATS = ("Real", "Float32", "Float64")


class FmuServer:
    """An FMU, unpacked, and its instances."""

    def __init__(self, path: str, folder: Path) -> None:
        """Unpack an FMU and read its description.

        Args:
            path: The file.
            folder: An empty folder.

        Raises:
            FmuError: The FMU cannot be used.
        """
        import fmpy

        extract(Path(path), folder)
        self._folder = folder
        try:
            self._description = fmpy.read_model_description(str(folder), validate=False)
        except Exception as error:  # fmpy raises plain exceptions
            raise FmuError(f"its description is wrong: {error}") from error
        if self._description.coSimulation is None:
            raise FmuError("it is not for co-simulation")
        self._variables = {each.name: each for each in self._description.modelVariables}
        self._fmus: list[Any] = []

    def describe(self, variables: Sequence[str]) -> dict[str, Any]:
        """Return facts about the FMU, and the causality of some variables."""
        simulation, found = self._description.coSimulation, {}
        for name in variables:
            variable = self._variables.get(name)
            if variable is None:
                raise FmuError(f"it has no variable `{name}`; it has {', '.join(sorted(self._variables)[:30])}")
            if variable.type not in NUMERIC or variable.dimensions:
                raise FmuError(f"its variable `{name}` is no number, but of type {variable.type}")
            found[name] = {"causality": variable.causality, "is_settable": _is_settable(variable)}
        return {
            "fmi": self._description.fmiVersion,
            "name": self._description.modelName,
            "tool": self._description.generationTool or "",
            "variables": found,
            "fmpy": metadata.version("fmpy"),
            "only_once": bool(simulation.canBeInstantiatedOnlyOncePerProcess),
            "lacks": [
                word
                for word, there in (
                    ("canGetAndSetFMUState", simulation.canGetAndSetFMUstate),
                    ("canSerializeFMUState", simulation.canSerializeFMUstate),
                )
                if not there
            ],
        }

    def start(
        self,
        states: Sequence[Sequence[float]],
        outputs: Sequence[str],
        inputs: Sequence[str],
        parameters: dict[str, float],
    ) -> list[list[float]]:
        """Create an instance for each initial state, and return the outputs of each."""
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self._outputs, self._inputs = list(outputs), list(inputs)
        self._is_second = self._description.fmiVersion.startswith("2")
        for number, state in enumerate(states):
            common = {
                "guid": self._description.guid,
                "unzipDirectory": str(self._folder),
                "modelIdentifier": self._description.coSimulation.modelIdentifier,
                "instanceName": f"agent_{number}",
            }
            fmu = FMU2Slave(**common) if self._is_second else FMU3Slave(**common)
            fmu.instantiate()
            for name, value in {**dict(zip(outputs, state, strict=True)), **parameters}.items():
                if _is_settable(self._variables[name]):
                    self._set(fmu, [name], [value])
                elif name in parameters:
                    raise FmuError(f"its variable `{name}` cannot be set before the start")
            if self._is_second:
                fmu.setupExperiment(startTime=0.0)
                fmu.enterInitializationMode()
            else:
                fmu.enterInitializationMode(startTime=0.0)
            fmu.exitInitializationMode()
            self._fmus.append(fmu)
        return [self._get(fmu, self._outputs) for fmu in self._fmus]

    def step(self, time: float, step: float, rows: Sequence[int], inputs: Sequence[Sequence[float]]) -> Any:
        """Advance some instances by a step [s] under their inputs, and return their outputs."""
        for row, given in zip(rows, inputs, strict=True):
            fmu = self._fmus[row]
            self._set(fmu, self._inputs, given)
            if self._is_second:
                fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)
            else:
                _, ends, _, reached = fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)
                if ends:
                    raise FmuError(f"it asked to end the simulation at {reached:.9g} s")
        return [self._get(self._fmus[row], self._outputs) for row in rows]

    def capture(self) -> list[str]:
        """Return the state of each instance."""
        found = []
        for fmu in self._fmus:
            state = fmu.getFMUState()
            found.append(base64.b64encode(bytes(fmu.serializeFMUState(state))).decode())
            fmu.freeFMUState(state)
        return found

    def restore(self, states: Sequence[str]) -> None:
        """Restore states that `capture` returned."""
        for fmu, text in zip(self._fmus, states, strict=True):
            state = fmu.deserializeFMUState(base64.b64decode(text))
            fmu.setFMUState(state)
            fmu.freeFMUState(state)

    def _get(self, fmu: Any, names: Sequence[str]) -> list[float]:
        found = []
        for name in names:
            variable = self._variables[name]
            (value,) = getattr(fmu, f"get{variable.type}")([variable.valueReference])
            found.append(float(value))
        return found

    def _set(self, fmu: Any, names: Sequence[str], values: Sequence[float]) -> None:
        for name, value in zip(names, values, strict=True):
            variable = self._variables[name]
            if variable.type in _FLOATS:
                given: Any = float(value)
            elif not math.isfinite(value):
                raise FmuError(f"its variable `{name}` cannot be {value}")
            else:
                given = bool(value) if variable.type == "Boolean" else round(value)
            getattr(fmu, f"set{variable.type}")([variable.valueReference], [given])


def _is_settable(variable: Any) -> bool:
    """Return whether a variable may be set before initialisation (section 2.4.7.5 of the standard)."""
    if variable.variability == "constant":
        return False
    return bool(variable.initial in ("exact", "approx") or variable.causality in ("parameter", "input"))


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until the other side has closed the pipe; the first names the file and where to unpack it."""
    server: FmuServer | None = None
    while True:
        try:
            request = json.loads(read(requests))
        except EOFError:
            return
        try:
            if server is None:
                server = FmuServer(request["path"], Path(request["folder"]))
                answer = None
            else:
                answer = getattr(server, request["call"])(**request["with"])
        except Exception as error:  # errors of the FMU, of fmpy, or of this module: all are reported to the run
            write(answers, json.dumps({"error": f"{error}" or type(error).__name__}).encode())
        else:
            write(answers, json.dumps({"answer": answer}).encode())
