"""Episodes of a scenario, one after the other: actions in, observations and rewards out, as arrays for each team."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.api import Scenario, SteppedSimulation
from symaware_cli.core import AgentGroup
from symaware_cli.core.stateful import StateError
from symaware_cli.language import unused_path
from symaware_cli.learning.given_inputs import Given, written
from symaware_cli.learning.learning_task import LearningTask, bounds_of
from symaware_cli.learning.reward import Reward
from symaware_cli.learning.team import LearningError, Team
from symaware_cli.studies import seed_of
from symaware_cli.views import WorldFrames
from symaware_cli.world import DrawCount, is_finite

if TYPE_CHECKING:
    from symaware_cli.engine import StateMark
    from symaware_cli.language.build import Built
    from symaware_cli.learning.episode_view import EpisodeView

Array = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: The type of the elements of usual actions.
_DOUBLE = np.dtype(np.float64)

#: Two seeds for which a fresh simulation is compared with one that returned to its initial state.
_COMPARED = (0, 1)


class Functions(NamedTuple):
    """Functions of a `Team` that replace entries of the section `learning`.

    Attributes:
        observation: Returns the observation of each agent; shape (n,) or (n, k).
        reward: Returns the reward of each agent for the step that was made; shape (n,).
        terminate: Returns whether the episode of each agent is over; shape (n,).
    """

    observation: Callable[[Team], ArrayLike] | None = None
    reward: Callable[[Team], ArrayLike] | None = None
    terminate: Callable[[Team], ArrayLike] | None = None


class TeamStep(NamedTuple):
    """The results of a step for the agents of a team.

    Attributes:
        observations: The observations, zeros for absent agents; shape (n, k).
        rewards: The rewards; shape (n,).
        terminated: Whether the agent has left for good, or its condition holds; shape (n,).
        present: Whether the agent is in the world; shape (n,).
    """

    observations: Array
    rewards: Array
    terminated: Truths
    present: Truths


class StepActions:
    """The control inputs of the present step, as `Simulation.overrides`."""

    #: Control inputs belong to the caller, and are not captured.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self) -> None:
        self.given: Mapping[AgentGroup, Given] = {}

    def __call__(self, step: int) -> Mapping[AgentGroup, Given]:
        """Return the control inputs of the present step."""
        return self.given


class TeamTask:
    """A team with the functions of its observations, rewards and terminations.

    Attributes:
        team: The team.
    """

    def __init__(self, task: LearningTask, team: Team, functions: Functions) -> None:
        """Compile the task."""
        self.team = team
        self._functions = functions
        self._observation = task.observation(team)
        self._reward: Reward = task.reward(team)
        self._termination = task.termination(team)
        self._everybody = self._seen = team.everybody

    def begin(self) -> TeamStep:
        """Observe the beginning of an episode."""
        with self._quiet():
            self._seen = self.team.present.copy()
            if self._functions.reward is None:
                self._reward.begin()
            nothing = np.zeros(len(self._seen))
            return TeamStep(self._observed(self._seen), nothing, nothing > 0.0, self._seen)

    def step(self) -> TeamStep:
        """Observe and reward a step that was made."""
        with self._quiet():
            team, functions = self.team, self._functions
            present, left = self._everybody, None
            if team.of.present is not None:
                present = team.present
                left = self._seen & ~present
                if team.of.returning is not None:
                    left &= ~team.of.returning[team.rows]
                self._seen = self._seen | present
            count = len(team.agents)
            if functions.reward is None:
                rewards = self._reward.step(count)
            else:
                rewards = _checked("the reward", self._called(functions.reward), (count,))
            if functions.terminate is not None:
                over = _checked("the termination", self._called(functions.terminate), (count,)) != 0.0
            else:
                over = np.zeros(count, bool) if self._termination is None else self._termination()
            if left is None:
                return TeamStep(self._observed(present), rewards, over, present)
            return TeamStep(self._observed(present), np.where(present, rewards, 0.0), left | (present & over), present)

    def _observed(self, present: Truths) -> Array:
        function = self._functions.observation
        if function is None:
            found = self._observation()
        else:
            found = np.array(self._called(function), float)
            found = found[:, None] if found.ndim == 1 else found
            _checked("the observation", found, (len(self.team.agents), found.shape[-1]))
        if not is_finite(found):
            found[np.isnan(found)] = 0.0
        if present is not self._everybody:
            found[~present] = 0.0
        return found

    def _quiet(self) -> np.errstate:
        """Turn off NumPy's warnings, except in functions; once for all expressions, because it takes time."""
        if any(self._functions):
            self._settings = np.geterr()
        return np.errstate(all="ignore")

    def _called(self, function: Callable[[Team], ArrayLike]) -> ArrayLike:
        with np.errstate(**self._settings):
            return function(self.team)


class Episodes:
    """Episodes of a scenario, in one simulation that is reset, or in a new one for each.

    Attributes:
        teams: The learning agents by group.
        functions: The functions that replace entries of the section `learning`.
        task: The section `learning`.
        spaces: The bounds of the actions of each team, each of shape (nu,).
        widths: The number of observed values of the agents of each team.
        seed: The seed of the present episode.
        builder: Builds the scenario for a seed.
        index: The number of episodes since a seed was given.
        own_seed: The seed of the scenario.
        returns: Whether a new episode begins by returning to a mark, instead of building the scenario again.
    """

    def __init__(self, scenario: Scenario, changes: Mapping[str, Any], functions: Functions) -> None:
        """Build the scenario.

        Raises:
            ScenarioError: The scenario has problems.
            LearningError: The scenario has no section `learning`, or a function returns a value of another shape.
        """
        self._scenario = scenario
        self._view: EpisodeView | None = None
        self.functions = functions
        self.builder = self._build = scenario.builder(changes)
        self._mark: StateMark | None = None
        self._simulation: SteppedSimulation | None = None
        self._actions = StepActions()
        self._history: list[Mapping[AgentGroup, Given]] = []
        self._tasks: list[TeamTask] = []
        self.seed, self.index = 0, -1
        self._root: int | None = None
        with DrawCount() as drawn:
            self._start(_COMPARED[0])
        self.own_seed = self._built_seed()
        if not drawn.count:
            self._mark = self._marked()
        self.returns = self._mark is not None
        simulation = self.simulation
        simulation.step()
        self.spaces = [bounds_of(each.team.of, self.task.content.action) for each in self._tasks]
        self.widths = [each.begin().observations.shape[1] for each in self._tasks]
        self.teams = tuple(each.team for each in self._tasks)

    def _built_seed(self) -> int:
        return self._build(None).document.seed

    @property
    def simulation(self) -> SteppedSimulation:
        """The simulation of the present episode.

        Raises:
            LearningError: The environment was closed.
        """
        if self._simulation is None:
            raise LearningError("the environment was closed")
        return self._simulation

    @property
    def is_over(self) -> bool:
        """Whether the run is over."""
        return self.simulation.done

    @property
    def is_complete(self) -> bool:
        """Whether all steps of the run were made."""
        return self.simulation.steps == self._steps

    @property
    def time_step(self) -> float:
        """The time step of the world [s]."""
        return self.built.simulation.environment.time_step / 1e9

    def _start(self, seed: int) -> None:
        """Build the simulation of a seed."""
        self._end()
        self._frames: WorldFrames | None = None
        self.built: Built = self._build(seed)
        task = self.built.sections.get("learning")
        if not isinstance(task, LearningTask):
            raise LearningError("name the agents that learn: `agents=`, or a section `learning` in the scenario")
        if task.inputs is not None:
            raise LearningError("this scenario repeats an episode: `learning.inputs` has its actions")
        self.task = task
        simulation = self.built.simulation
        simulation.overrides = self._actions
        self._steps = self.built.steps
        log = None if self._view is None else self._view.begin()
        self._simulation = SteppedSimulation(self.built, log, within_steps=True)
        document, options = self.built.document, self.built.options
        names = {each.name: each for each in options.specifications}
        teams = task.teams(simulation.groups, simulation.environment, document.regions, names)
        self._tasks = [TeamTask(task, team, self.functions) for team in teams]
        self.teams = tuple(teams)

    def _marked(self) -> StateMark | None:
        """Return a mark of the initial state; None if a simulation that returns there differs from a new one."""
        simulation, seed = self.simulation, _COMPARED[1]
        try:
            found = simulation.mark()
            simulation.go_back(found, seed)
            other = self._build(seed)
            other.simulation.overrides = StepActions()
            with SteppedSimulation(other, None, within_steps=True) as fresh:
                states = [replace(each.capture(), scenario="").to_bytes() for each in (simulation, fresh)]
            simulation.go_back(found)
        except StateError:
            self._start(_COMPARED[0])
            return None
        return found if states[0] == states[1] else None

    def begin(self, seed: int | None = None) -> list[TeamStep]:
        """Begin the next episode.

        Args:
            seed: The seed from which the seeds of this and the following episodes are derived, like those of the runs
                of a sweep; None to continue the series, which by default begins with the scenario's seed.

        Returns:
            The observations of each team.
        """
        if seed is not None or self._root is None:
            self._root, self.index = self.own_seed if seed is None else int(seed), 0
        else:
            self.index += 1
        return self.begin_with(seed_of(self._root or 0, self.index))

    def begin_with(self, seed: int) -> list[TeamStep]:
        """Begin an episode with the seed of its run; see `begin`."""
        self.seed = seed
        self._history, self._actions.given = [], {}
        if self._mark is not None and self._view is None:
            self.simulation.go_back(self._mark, self.seed)
        else:
            self._start(self.seed)
        self.simulation.step()
        return [each.begin() for each in self._tasks]

    def step(self, actions: Mapping[str, ArrayLike]) -> list[TeamStep]:
        """Make a step.

        Args:
            actions: The control inputs of learning agents, shape (nu,); components drive agents without one.

        Returns:
            The results of the step for each team.

        Raises:
            KeyError: An action is for an agent that does not learn.
            ValueError: An action has another shape, or is not finite.
            RunFailedError: A component or the world failed.
        """
        given: dict[AgentGroup, Given] = {}
        left = len(actions)
        for team in self.teams:
            own, used = _given(team, actions)
            left -= used
            if own is not None:
                given[team.of] = own
        if left:
            known = {id for team in self.teams for id in team.agents}
            unknown = next((id for id in actions if id not in known), None)
            if unknown is not None:
                raise KeyError(f"{unknown} is no agent that learns")
        self._actions.given = given
        self._history.append(given)
        self.simulation.step()
        if self._view is not None:
            self._view.wait(self.time_step)
        return [each.step() for each in self._tasks]

    def draw(self) -> NDArray[np.uint8]:
        """Draw the world at the present instant; see `WorldFrames.draw`."""
        if self._frames is None:
            simulation = self.built.simulation
            self._frames = WorldFrames(simulation.environment, simulation.groups, self.built.document.regions)
        return self._frames.draw()

    def record(self, output: str | os.PathLike[str] | None = None) -> Path:
        """Write the log of the present episode, which contains its actions, by repeating it.

        Args:
            output: The path of the log; by default NAME.mcap, or NAME-2.mcap and so on, in the current folder.

        Returns:
            The path.

        Raises:
            LearningError: No step was made, or the repetition differs.
            LogError: The log cannot be written.
        """
        simulation, built = self.simulation, self.built
        steps = simulation.steps
        if not steps:
            raise LearningError("no step of this episode was made")
        path = unused_path(built.document.name) if output is None else Path(output)
        with tempfile.TemporaryDirectory(prefix="symaware-") as folder:
            for name, content in built.files.items():
                place = Path(folder, name)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
            scenario = unused_path("episode", Path(folder), ".yaml")
            scenario.write_bytes(built.resolved)
            actions = unused_path("actions", Path(folder), ".csv")
            actions.write_bytes(written(self._history))
            changes: dict[str, Any] = {"learning.inputs": actions.name}
            if not simulation.done:
                changes["run.duration"] = steps * self.time_step
            repeated = Scenario(scenario, changes, seed=self.seed, trust=True)
            result = repeated.run(output=path)
        if result.summary.steps != steps:
            raise LearningError(f"{path}: the repetition ended after {result.summary.steps} steps, not {steps}")
        for group in built.simulation.groups if "world" not in built.document.recording.omit else ():
            present = group.in_world
            if present.any():
                expected = built.simulation.environment.state(group)[present]
                found = result.series(group.name, "world").values[-1].reshape(len(group), -1)[present]
                if found.tobytes() != np.ascontiguousarray(expected).tobytes():
                    raise LearningError(f"{path}: the repetition differs in the states of `{group.name}`")
        return path

    def show(self, view: EpisodeView) -> None:
        """Show all further episodes in a viewer; they are built anew, since a simulation with a log cannot go back."""
        self._view = view

    def close(self) -> None:
        """End the present episode, and the view."""
        self._end()
        if self._view is not None:
            self._view.close()

    def _end(self) -> None:
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None


def _given(team: Team, actions: Mapping[str, ArrayLike]) -> tuple[Given | None, int]:
    """Return the control input of each agent of a team, or None, and the number of agents with one."""
    group, ids = team.of, team.agents
    width = len(group.model.control_input)
    found: list[Any] = [*map(actions.get, ids)]
    try:
        # All agents at once if each has an array: one agent at a time this would take as long as a component.
        joined = np.concatenate(found)  # None raises an error, which is caught
        is_plain = joined.dtype is _DOUBLE and joined.shape == (len(ids) * width,) and {*map(len, found)} == {width}
    except (TypeError, ValueError):
        is_plain = False
    if is_plain and len(ids) == len(group) and is_finite(joined):
        return (team.everybody, joined.reshape(-1, width)), len(ids)
    mask, values = np.zeros(len(group), bool), np.zeros((len(group), width))
    for row, id, action in zip(team.rows.tolist(), ids, found, strict=True):
        if action is not None:
            mask[row] = True
            values[row] = _action(id, action, width)
    return ((mask, values) if mask.any() else None), int(mask.sum())


def _action(id: str, action: ArrayLike, width: int) -> Array:
    found = np.asarray(action, float)
    if found.shape != (width,):
        raise ValueError(f"the action of {id} has shape {found.shape}, not {(width,)}")
    if not np.isfinite(found).all():
        raise ValueError(f"the action of {id} is not finite: {found.tolist()}")
    return found


def _checked(what: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    found = np.asarray(value, float)
    if found.shape != shape:
        raise LearningError(f"{what} has shape {found.shape}, not {shape}")
    return found
