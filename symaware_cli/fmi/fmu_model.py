"""An FMU as the model of a group of agents.

Reasons: docs/decisions/0094-fmi.md
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field, model_validator

from symaware_cli.assets import asset
from symaware_cli.core import Entity, Model, Parameters, Quantity, WorldError
from symaware_cli.core.stateful import StateError
from symaware_cli.fmi.fmu_archive import FmuError, check_archive
from symaware_cli.fmi.fmu_process import FmuProcess
from symaware_cli.geometry import Array, AssetPath
from symaware_cli.plugin_files import FileSet, hand_down, is_trusted
from symaware_cli.world import StepSimulator

INSTALL = "pip install 'symaware-cli[fmi]'"


class FmuFile(Parameters):
    """The file of an FMU."""

    file: AssetPath = Field(description="An .fmu file for co-simulation, FMI 2 or 3, below the scenario's folder.")


class FmuQuantity(Parameters):
    """An element of the state or of the control input."""

    unit: str = Field("", description="Its unit, such as `m`.")
    variable: str | None = Field(
        None, description="The variable of the FMU; an element of the state without one keeps its initial value."
    )


class FmuInput(Parameters):
    """An element of the control input."""

    unit: str = Field("", description="Its unit, such as `m/s`.")
    variable: str | None = Field(None, description="The input of the FMU that it sets; without one it has no effect.")
    limit: float | None = Field(None, gt=0, description="Its greatest magnitude; no limit if null.")


class Fmu(Model):
    """An FMU (FMI 2 or 3, co-simulation), with one instance for each agent.

    The elements of the state are variables of the FMU, read after each step; the control input sets its inputs, which
    are held over the step. A world calls the FMU once in each of its time steps, in a separate process.

    An FMU is code: a scenario is refused unless it is run with ``--trust``. Other components cannot evaluate its
    equations: for predictions, each element of the state has the rate that `rates` names, and otherwise stays as it is.

    A run can be captured if the FMU can get, set and serialise its state.
    """

    needs = ("co-simulation",)

    class Parameters(Parameters):
        """The FMU, and the variables that are used."""

        fmu: FmuFile = Field(description="The file.")
        state: dict[str, FmuQuantity] = Field(min_length=1, description="The elements of the state, in order.")
        control_input: dict[str, FmuInput] = Field(
            default={"idle": FmuInput()},
            min_length=1,
            description="The elements of the control input, in order; by default one without effect.",
        )
        position: list[str] = Field(
            default=["x", "y"],
            min_length=2,
            max_length=3,
            description="Elements of the state that are the position [m].",
        )
        heading: str | None = Field(None, description="Element of the state that is the heading [rad].")
        rates: dict[str, str] = Field(
            default_factory=dict, description="Rates of elements of the state, each another element."
        )
        parameters: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = Field(
            default_factory=dict, description="Values of parameters of the FMU, by their names."
        )

        @model_validator(mode="after")
        def _names_elements(self) -> Fmu.Parameters:
            named = [*self.position, *self.rates, *self.rates.values(), *([self.heading] if self.heading else [])]
            missing = [name for name in named if name not in self.state]
            if missing:
                raise ValueError(f"`{missing[0]}` is no element of `state`, which has {', '.join(self.state)}")
            if len(set(self.position)) < len(self.position):
                raise ValueError("`position` names an element twice")
            return self

    uncaptured: ClassVar = ("_path", "_facts")

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        given = self.parameters
        names = list(given.state)
        self.state = tuple(Quantity(name, each.unit) for name, each in given.state.items())
        self.control_input = tuple(Quantity(name, each.unit) for name, each in given.control_input.items())
        self.position = tuple(names.index(name) for name in given.position)
        self.heading = None if given.heading is None else names.index(given.heading)
        self._rates = tuple(names.index(given.rates[name]) if name in given.rates else None for name in names)
        self._path: Path | None = None
        self._facts: dict[str, Any] = {}

    def fit(self, entity: Entity, folders: Any, *where: str) -> None:
        """Check that the file is sound and trusted, and that it has the variables.

        Raises:
            WorldError: The FMU cannot be used.
        """
        file, place = self.parameters.fmu.file, (*where, "model", "with", "fmu", "file")
        path = asset.find(file, folders, *place)
        try:
            digest = check_archive(path)
            code = FileSet(folders.home, (file,), {file: path.read_bytes()})
            if not is_trusted(code):
                raise FmuError("an FMU is code, and it is not trusted: --trust for one command")
            if find_spec("fmpy") is None:
                raise FmuError(f"FMUs need the module `fmpy`, which is not installed: {INSTALL}")
            hand_down(code)
            process = FmuProcess(path)
            try:
                self._facts = process.call("describe", variables=[*self._outputs, *self._inputs, *self._settings])
            finally:
                process.close()
        except FmuError as error:
            raise WorldError(f"the FMU `{file}` cannot be used: {error}", *place) from error
        for name in self._inputs:
            if self._facts["variables"][name]["causality"] != "input":
                raise WorldError(f"the variable `{name}` of `{file}` is no input", *where, "model", "with")
        self._facts["sha256"] = digest
        self._path = path

    @property
    def _outputs(self) -> list[str]:
        return [each.variable for each in self.parameters.state.values() if each.variable is not None]

    @property
    def _inputs(self) -> list[str]:
        return [each.variable for each in self.parameters.control_input.values() if each.variable is not None]

    @property
    def _settings(self) -> list[str]:
        return list(self.parameters.parameters)

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the declared rates, and 0 for elements without one."""
        return [0.0 * state[0] if rate is None else state[rate] for rate in self._rates]

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the declared limits."""
        high = [np.inf if each.limit is None else each.limit for each in self.parameters.control_input.values()]
        return [-bound for bound in high], high

    def attachments(self) -> Mapping[str, bytes]:
        """Return facts about the FMU: its digest, the tool that made it, and the versions of FMI and of fmpy."""
        facts = {key: self._facts[key] for key in ("name", "sha256", "fmi", "tool", "fmpy") if key in self._facts}
        return {"fmu.json": json.dumps(facts, indent=1).encode()}

    def simulator(self, time_step: int) -> StepSimulator:
        """Return the instances of the agents."""
        assert self._path is not None, "the model was fitted before"
        return FmuSimulator(self, self._path, self._facts, time_step)


class FmuSimulator(StepSimulator):
    """The instances of an FMU, one for each agent of a group."""

    uncaptured: ClassVar = ("*",)

    def __init__(self, model: Fmu, path: Path, facts: Mapping[str, Any], time_step: int) -> None:
        """Prepare; the process starts with the agents.

        Args:
            model: The model.
            path: The file.
            facts: The facts in the description of the FMU.
            time_step: The time step of the world [ns].
        """
        given = model.parameters
        self._file, self._path, self._facts, self._step = given.fmu.file, path, facts, time_step
        self._outputs = [each.variable for each in given.state.values() if each.variable is not None]
        self._places = [place for place, each in enumerate(given.state.values()) if each.variable is not None]
        self._names = [name for name, each in given.state.items() if each.variable is not None]
        self._inputs = [each.variable for each in given.control_input.values() if each.variable is not None]
        self._given = [place for place, each in enumerate(given.control_input.values()) if each.variable is not None]
        self._parameters = dict(given.parameters)
        self._process: FmuProcess | None = None

    def start(self, states: Array) -> None:
        """Create the instances in their initial states.

        Raises:
            ValueError: The FMU cannot be set to these states, or cannot be used.
        """
        if len(states) > 1 and self._facts["only_once"]:
            raise ValueError(
                f"the FMU `{self._file}` can be instantiated only once, and there are {len(states)} agents"
            )
        try:
            self._process = FmuProcess(self._path)
            found = np.array(
                self._process.call(
                    "start",
                    states=states[:, self._places].tolist(),
                    outputs=self._outputs,
                    inputs=self._inputs,
                    parameters=self._parameters,
                )
            )
        except FmuError as error:
            raise ValueError(f"the FMU `{self._file}` does not start: {error}") from error
        differ = np.argwhere(found.reshape(len(states), -1) != states[:, self._places])
        if len(differ):
            row, column = differ[0].tolist()
            raise ValueError(
                f"the FMU `{self._file}` begins with `{self._names[column]}` = {found[row, column].item()!r}, and the "
                f"scenario says {states[row, self._places[column]].item()!r}, which it cannot be set to"
            )

    def step(self, time: int, states: Array, inputs: Array, rows: Sequence[int]) -> Array:
        """Return the states of some rows after a step from a time [ns] under given inputs."""
        assert self._process is not None
        try:
            found = self._process.call(
                "step",
                time=time / 1e9,
                step=self._step / 1e9,
                rows=list(rows),
                inputs=inputs[np.ix_(list(rows), self._given)].tolist(),
            )
        except FmuError as error:
            raise RuntimeError(f"the FMU `{self._file}` fails at {time / 1e9:.9g} s: {error}") from error
        after = states.copy()
        if self._places:
            after[np.ix_(list(rows), self._places)] = found
        return after

    def captured(self) -> Any:
        """Return the states of the instances.

        Raises:
            StateError: The FMU cannot return its state.
        """
        if self._facts["lacks"]:
            raise StateError(f"the FMU `{self._file}` has no {' and no '.join(self._facts['lacks'])}")
        if self._process is None:
            return []
        try:
            return self._process.call("capture")
        except FmuError as error:
            raise StateError(f"the state of the FMU `{self._file}` cannot be retrieved: {error}") from error

    def restored(self, state: Any) -> None:
        """Set the states of the instances."""
        if self._process is not None and state:
            self._process.call("restore", states=state)
