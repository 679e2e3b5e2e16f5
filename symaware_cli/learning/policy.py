"""Trained policies, as a component of a scenario and as a function for episodes."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from symaware_cli.core import AgentGroup, GroupComponent, ScenarioView
from symaware_cli.geometry import AssetPath
from symaware_cli.learning.learning_task import LearningTask
from symaware_cli.learning.onnx_file import OnnxError
from symaware_cli.learning.policy_network import ActionNetwork, PolicyNetwork
from symaware_cli.learning.runtime_network import SETTINGS, RuntimeNetwork
from symaware_cli.learning.team import LearningError, Team
from symaware_cli.world import ParameterError, UserError
from symaware_cli.world import Parameters as PluginParameters

Array = NDArray[np.float64]

_PLACE = ("policy", "file")

Runtime: TypeAlias = Literal["own", "onnxruntime"]
"""The runtime of networks: own kernels, equal to the bit on every processor, or a library with all of ONNX."""

_RUNTIMES: Mapping[Runtime, type[PolicyNetwork | RuntimeNetwork]] = {
    "own": PolicyNetwork,
    "onnxruntime": RuntimeNetwork,
}

#: How far numbers of a repeated run may be off by default: single precision, in a loop that does not amplify it much.
_TOLERANCE = 1e-6


class PolicyError(UserError):
    """A file of a policy cannot be used."""

    status = 2


class Policy:
    """A trained policy as a function from observations to actions, equal to those of `control.policy` to the bit.

    Attributes:
        observed: The number of values of an observation.
        actions: The number of values of an action.
    """

    def __init__(self, path: str | os.PathLike[str], runtime: Runtime = "own") -> None:
        """Read a file in the format ONNX; docs/learning.md lists the operators.

        Args:
            path: The file.
            runtime: ``onnxruntime`` for other operators, with the extra `onnx`.

        Raises:
            PolicyError: The file cannot be read, is damaged, or contains an unsupported feature.
        """
        try:
            self._network: ActionNetwork = _RUNTIMES[runtime].read(Path(path), os.fspath(path))
        except OnnxError as error:
            raise PolicyError(str(error)) from error
        self.observed, self.actions = self._network.observed, self._network.actions
        self._states: tuple[Array, ...] = ()
        self._rows = -1

    def reset(self) -> None:
        """Begin a new episode: set the state of a recurrent policy to 0."""
        self._rows = -1

    def __call__(self, observations: ArrayLike) -> Array:
        """Return the actions of several agents, or of one, and keep the state of a recurrent policy.

        Args:
            observations: Shape (n, observed), or (observed,) for one agent. For a recurrent policy, n must not change.

        Returns:
            Shape (n, actions), or (actions,).

        Raises:
            PolicyError: The runtime `onnxruntime` cannot compute them.
            ValueError: The observations have another shape.
        """
        given = np.asarray(observations, float)
        rows = given[None] if given.ndim == 1 else given
        if rows.ndim != 2 or rows.shape[1] != self.observed:
            raise ValueError(f"the observations have the shape {given.shape}, not ({self.observed},) for each agent")
        if self._rows < 0:
            self._rows, self._states = len(rows), self._network.initial_states(len(rows))
        if self._states and len(rows) != self._rows:
            raise ValueError(f"{len(rows)} agents in an episode of {self._rows}: call `reset` before another one")
        try:
            actions, self._states = self._network(rows, self._states)
        except OnnxError as error:
            raise PolicyError(str(error)) from error
        return actions[0] if given.ndim == 1 else actions


class PolicyFile(PluginParameters):
    """A trained policy."""

    file: AssetPath = Field(description="An .onnx file below the scenario's folder.")
    runtime: Runtime = Field(
        "own",
        description="Runtime: `own`, the same bytes on every processor, or `onnxruntime`, which has more "
        "operators, and whose results depend on the processor.",
    )
    tolerance: float | None = Field(
        None,
        gt=0.0,
        description="Tolerance of numbers in the log of a repeated run with `onnxruntime`, absolute and relative; "
        "by default 1e-6.",
    )

    @model_validator(mode="after")
    def _has_tolerance_where_needed(self) -> PolicyFile:
        if self.runtime == "own" and self.tolerance is not None:
            raise ValueError("a tolerance is for `runtime: onnxruntime`; other results are repeated to the bit")
        return self


class PolicyTurn(NamedTuple):
    """The result of a turn.

    Attributes:
        actions: The control input of each agent; shape (n, nu).
        states: The next state of a recurrent policy.
    """

    actions: Array
    states: tuple[Array, ...]


class PolicyController(GroupComponent):
    """Controls agents by a trained policy: a network in a file of the format ONNX.

    The policy gets the observations that the section `learning` of the scenario defines, and its output is the control
    input, like an action of the environment. Declare the component after those that perceive and receive messages,
    since the policy observes their beliefs. Undefined numbers of observations are 0, as in episodes. The state of a
    recurrent policy is 0 at first and while an agent is absent.

    Networks of dense layers and gated recurrent units are computed in double precision and in a fixed order, so a run
    has the same bytes with every number of agents. A file with other operators is refused, unless `runtime` is
    `onnxruntime`, which computes each agent by itself; then repeated runs are compared to a tolerance.
    """

    # Observations depend on agents of the same run only, and the network computes each row independently.
    batchable = True
    sees_world = True

    class Parameters(PluginParameters):
        """The policy."""

        policy: PolicyFile = Field(description="The trained policy.")

    # These attributes follow from the scenario.
    uncaptured = ("_network", "_observe")

    def check(self, group: AgentGroup) -> None:
        """Check the file, and that its output is a control input of the model."""
        name = self.parameters.policy.file
        if not (group.folder / name).is_file():
            return  # a missing file is reported where the scenario names it
        network = self._read(group.folder)
        names = [quantity.name for quantity in group.model.control_input]
        if network.actions != len(names):
            expected = f"{len(names)} ({', '.join(names)})"
            raise ParameterError(
                f"{name}: its output has {network.actions} values, and a control input of this model {expected}", _PLACE
            )

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that there is a section `learning`, and that its observations have the size that the policy expects."""
        entry = view.entry
        task: LearningTask | None = None if entry is None else entry.group.sections.get("learning")
        if entry is None or task is None:
            if entry is not None and view.document.learning is None:
                view.report("a policy needs the observations of the section `learning`, and there is none", "use")
            return
        try:
            observe = _observation(entry.group, task, view.environment, view.groups, tuple(view.specifications))
            if not view.is_initialised or not hasattr(view.groups[0], "surroundings"):
                return
            found = observe().shape[1]
            network = self._read(entry.group.folder)
        except LearningError as error:
            if not any(entry.group.name in rows for _, _, rows in task.members(view.groups)):  # else it is reported
                name = entry.group.name
                said = f"the agents of `{name}` do not have the observations of `learning.observation`: {error}"
                view.report(said, "use")
            return
        if found != network.observed:
            name = self.parameters.policy.file
            view.report(
                f"{name}: it observes {network.observed} values, and `learning.observation` has {found} of the agents "
                f"of `{entry.group.name}`",
                "with",
                *_PLACE,
                key=False,
            )

    def initialise_component(self, group: AgentGroup) -> None:
        """Read the policy, and set its state to 0."""
        super().initialise_component(group)
        self._network = self._read(self.environment.folder)
        self._observe: Callable[[], Array] | None = None
        self._states = self._network.initial_states(len(group))

    @property
    def repeatable_to(self) -> float | None:
        """The tolerance of a policy that `onnxruntime` computes."""
        policy = self.parameters.policy
        return None if policy.runtime == "own" else policy.tolerance or _TOLERANCE

    def attachments(self) -> Mapping[str, bytes]:
        """Return the settings of `onnxruntime`, if it computes the policy."""
        if self.parameters.policy.runtime == "own":
            return {}
        return {"runtime.json": json.dumps(dict(SETTINGS), indent=1).encode()}

    def _read(self, folder: Path) -> ActionNetwork:
        policy = self.parameters.policy
        name = policy.file
        try:
            return _RUNTIMES[policy.runtime].read(folder / name, name)
        except OnnxError as error:
            raise ParameterError(str(error), _PLACE) from error

    def _compute(self) -> PolicyTurn:
        group = self._group
        if self._observe is None:
            task: LearningTask = group.sections["learning"]
            self._observe = _observation(group, task, self.environment, self.environment.groups, task.specifications)
        observations = self._observe()
        unknown = np.isnan(observations)
        if unknown.any():
            observations[unknown] = 0.0
        try:
            return PolicyTurn(*self._network(observations, self._states))
        except OnnxError as error:
            raise PolicyError(f"{self.parameters.policy.file}: {error}") from error

    def _update(self, value: PolicyTurn) -> None:
        group = self._group
        group.control_input = value.actions
        states = value.states
        if group.present is not None and states and not group.present.all():
            states = tuple(each.copy() for each in states)
            for each, shape in zip(states, self._network.states, strict=True):
                np.moveaxis(each, shape.index(None), 0)[~group.present] = 0.0
        self._states = states


def _observation(
    group: AgentGroup,
    task: LearningTask,
    environment: Any,
    groups: Sequence[Any],
    specifications: Sequence[str],
) -> Callable[[], Array]:
    """Return the function that computes the observations of all agents of a group, as in episodes; shape (n, k).

    Raises:
        LearningError: The observations are not defined for these agents.
    """
    team = Team(group, range(len(group)), environment, groups, group.regions, specifications)
    return task.observation(team)
