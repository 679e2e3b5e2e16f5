"""Creates the environments of Gymnasium and PettingZoo of a scenario (docs/learning.md)."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from symaware_cli import processor
from symaware_cli.api import Scenario
from symaware_cli.learning.episodes import Episodes, Functions
from symaware_cli.learning.team import LearningError, Team

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode

    from symaware_cli.learning.episode_view import EpisodeView
    from symaware_cli.learning.parallel_environment import ScenarioParallelEnv
    from symaware_cli.learning.single_environment import ScenarioEnv
    from symaware_cli.learning.team_vector_environment import ScenarioTeamVectorEnv
    from symaware_cli.learning.vector_environment import ScenarioVectorEnv

#: The name of the environment in Gymnasium.
ID = "symaware/Scenario-v0"

#: A value as in the section `learning`, or a function of a `Team`.
Said = str | Mapping[str, Any] | Sequence[Any] | Callable[[Team], Any] | None


def env(
    scenario: str | os.PathLike[str] | Scenario,
    agents: str | Sequence[str] | None = None,
    observation: Said = None,
    action: Mapping[str, Any] | None = None,
    reward: Said = None,
    terminate: str | Callable[[Team], Any] | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    render_mode: str | None = None,
    connect: str | None = None,
) -> ScenarioParallelEnv:
    """Return a scenario as a parallel environment of PettingZoo.

    Each argument from `agents` to `terminate` replaces the value in the section `learning` of the scenario.

    Args:
        scenario: A scenario file, a log, or a `Scenario`.
        agents: The agents that learn: a group, an agent, or several of these. Components drive all others.
        observation: As in the section, or a function of a `Team` that returns shape (n,) or (n, k).
        action: The bounds ``low`` and ``high`` of the actions, which are control inputs.
        reward: As in the section, or a function of a `Team` that returns shape (n,).
        terminate: As in the section, or a function of a `Team` that returns shape (n,).
        changes: Values that replace those of the file, by their paths.
        render_mode: ``rgb_array`` to draw frames, ``human`` to show all episodes in the Rerun viewer, or None.
        connect: The URL of a running viewer, for ``human``; None to start one.

    Raises:
        ScenarioError: The scenario has problems; each is located.
        LearningError: The learning agents are not specified, or a function returns a value of another shape.
        ImportError: PettingZoo is not installed.
        LogError: Rerun is not installed, which ``human`` needs.
        ValueError: There is no such mode, or a viewer without ``human``.

    Warns:
        ProcessorWarning: See `Scenario.run`.
    """
    _require("pettingzoo")
    view = _view(render_mode, connect)
    processor.warn_once(stacklevel=2)
    from symaware_cli.learning.parallel_environment import ScenarioParallelEnv

    episodes = Episodes(*_content(scenario, agents, observation, action, reward, terminate, changes))
    if view is not None:
        episodes.show(view)
    return ScenarioParallelEnv(episodes, render_mode)


def single_env(
    scenario: str | os.PathLike[str] | Scenario,
    agent: str | None = None,
    observation: Said = None,
    action: Mapping[str, Any] | None = None,
    reward: Said = None,
    terminate: str | Callable[[Team], Any] | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    render_mode: str | None = None,
    connect: str | None = None,
) -> ScenarioEnv:
    """Return a scenario with one learning agent as an environment of Gymnasium.

    Args:
        scenario: See `env`.
        agent: The agent that learns.
        observation: See `env`.
        action: See `env`.
        reward: See `env`.
        terminate: See `env`.
        changes: See `env`.
        render_mode: See `env`.
        connect: See `env`.

    Raises:
        ScenarioError: See `env`.
        LearningError: See `env`; or several agents learn.
        ImportError: Gymnasium is not installed.

    Warns:
        ProcessorWarning: See `Scenario.run`.
    """
    _require("gymnasium")
    view = _view(render_mode, connect)
    processor.warn_once(stacklevel=2)
    from symaware_cli.learning.single_environment import ScenarioEnv

    episodes = Episodes(*_content(scenario, agent, observation, action, reward, terminate, changes))
    ids = [id for team in episodes.teams for id in team.agents]
    if len(ids) > 1:
        episodes.close()
        raise _several(ids, "env")
    if view is not None:
        episodes.show(view)
    return ScenarioEnv(episodes, render_mode)


def vector_env(
    scenario: str | os.PathLike[str] | Scenario,
    num_envs: int,
    agents: str | Sequence[str] | None = None,
    observation: Said = None,
    action: Mapping[str, Any] | None = None,
    reward: Said = None,
    terminate: str | Callable[[Team], Any] | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    autoreset_mode: AutoresetMode | str = "next_step",
    batched: bool | None = None,
    mixes: bool = True,
    workers: int = 0,
    timeout: float | None = 60.0,
) -> ScenarioVectorEnv | ScenarioTeamVectorEnv:
    """Return many rows of a scenario as one environment; each equals `single_env` or `env`, byte for byte.

    Rows are computed as arrays, like the runs of a sweep, if the scenario can be batched; otherwise each row has a
    separate simulation, and the attribute `unbatched` gives the reason.

    Args:
        scenario: See `env`.
        num_envs: The number of rows.
        agents: See `env`. If one agent learns, the result is a vector environment of Gymnasium; if several do, it has
            arrays of shape (rows, agents, values).
        observation: See `env`.
        action: See `env`.
        reward: See `env`.
        terminate: See `env`.
        changes: See `env`.
        autoreset_mode: When a row whose episode is over begins the next one, as in Gymnasium: ``next_step``,
            ``same_step`` or ``disabled``.
        batched: Whether rows have to be computed as arrays; None if they are where possible.
        mixes: Whether functions are written for one environment, so that rows are not batched with them. If false, a
            function gets the agents of `Team.environments` environments, one environment after the other, and each of
            its rows depends on the agents of the same environment only.
        workers: The number of worker processes, each of which computes a block of rows; 0 for this process. Results do
            not depend on the number.
        timeout: Wall time after which a worker process that has finished no further row is considered hung [s]; None
            for no limit.

    Raises:
        ScenarioError: See `env`.
        LearningError: See `env`; agents differ in the number of observed values or control inputs; the scenario
            cannot be batched although `batched` is true; or worker processes cannot be started.
        ValueError: There is no such mode, no row, or no such number of processes.
        ImportError: Gymnasium is not installed.

    Warns:
        ProcessorWarning: See `Scenario.run`.
    """
    _require("gymnasium")
    processor.warn_once(stacklevel=2)
    if num_envs < 1:
        raise ValueError(f"a number of environments is at least 1, not {num_envs}")
    if workers < 0:
        raise ValueError(f"a number of worker processes is at least 0, not {workers}")
    import numpy as np
    from gymnasium.vector import AutoresetMode

    from symaware_cli.learning.row_arrays import EpisodeSource, RowSizes
    from symaware_cli.learning.row_definition import RowDefinition
    from symaware_cli.learning.team_vector_environment import ScenarioTeamVectorEnv
    from symaware_cli.learning.vector_environment import ScenarioVectorEnv
    from symaware_cli.learning.vector_episodes import VectorEpisodes

    mode = _mode(autoreset_mode, AutoresetMode)
    made = RowDefinition(*_content(scenario, agents, observation, action, reward, terminate, changes), batched, mixes)
    episodes = made.episodes()
    teams = episodes.teams
    if len({*episodes.widths}) > 1 or len({len(low) for low, _ in episodes.spaces}) > 1:
        said = ", ".join(
            f"`{team.group}` {width} and {len(low)}"
            for team, width, (low, _) in zip(teams, episodes.widths, episodes.spaces, strict=True)
        )
        episodes.close()
        raise LearningError(f"agents in one array have equal numbers of observed values and control inputs, not {said}")
    ids = [id for team in teams for id in team.agents]
    bounds = [
        np.concatenate(
            [np.tile(each[side], (len(team.agents), 1)) for team, each in zip(teams, episodes.spaces, strict=True)]
        )
        for side in range(2)
    ]
    fps = 1.0 / episodes.time_step
    source: EpisodeSource
    if workers:
        from symaware_cli.learning.worker_rows import WorkerRows

        sizes = RowSizes(num_envs, len(ids), episodes.widths[0], bounds[0].shape[1])
        digest = episodes.built.digest
        episodes.close()
        source = in_processes = WorkerRows(sizes, made, workers, timeout, digest)
        reason = in_processes.unbatched
    else:
        source, reason = made.rows(num_envs, episodes)
    rows = VectorEpisodes(source, episodes.own_seed, bounds[0].shape[1], mode)
    if len(ids) == 1:
        return ScenarioVectorEnv(ids[0], rows, (bounds[0][0], bounds[1][0]), fps, reason)
    return ScenarioTeamVectorEnv(ids, rows, (bounds[0], bounds[1]), fps, reason)


def single_vector_env(
    scenario: str | os.PathLike[str] | Scenario, num_envs: int, agent: str | None = None, **options: Any
) -> ScenarioVectorEnv:
    """Return rows with one learning agent each, for `gymnasium.make_vec`; see `vector_env`.

    Raises:
        LearningError: See `vector_env`; or several agents learn.
    """
    from symaware_cli.learning.vector_environment import ScenarioVectorEnv

    made = vector_env(scenario, num_envs, agent, **options)
    if not isinstance(made, ScenarioVectorEnv):
        made.close()
        raise _several(made.agents, "vector_env")
    return made


def _several(ids: Sequence[str], otherwise: str) -> LearningError:
    return LearningError(f"{len(ids)} agents learn: name one of {', '.join(ids[:9])}, or use `{otherwise}`")


def _mode(given: AutoresetMode | str, modes: type[AutoresetMode]) -> AutoresetMode:
    if isinstance(given, modes):
        return given
    found = {each.name.lower(): each for each in modes}.get(str(given))
    if found is None:
        raise ValueError(f"the autoreset mode {given!r} is not one of {', '.join(each.name.lower() for each in modes)}")
    return found


def _content(
    scenario: str | os.PathLike[str] | Scenario,
    agents: str | Sequence[str] | None,
    observation: Said,
    action: Mapping[str, Any] | None,
    reward: Said,
    terminate: str | Callable[[Team], Any] | None,
    changes: Mapping[str, Any] | None,
) -> tuple[Scenario, Mapping[str, Any], Functions]:
    """Return a scenario, the changes of its section `learning` by arguments, and functions."""
    said = {"agents": agents, "observation": observation, "action": action, "reward": reward, "terminate": terminate}
    if isinstance(observation, str):
        said["observation"] = [observation]
    paths = {f"learning.{key}": each for key, each in said.items() if each is not None and not callable(each)}
    functions = Functions(*(each if callable(each) else None for each in (observation, reward, terminate)))
    given = scenario if isinstance(scenario, Scenario) else Scenario(scenario)
    return given, {**(changes or {}), **paths}, functions


def _register() -> None:
    """Register `single_env` with Gymnasium, if it is installed."""
    if find_spec("gymnasium") is not None:
        from gymnasium.envs.registration import register, registry

        if ID not in registry:
            register(ID, f"{__name__}:single_env", vector_entry_point=f"{__name__}:single_vector_env")


def _require(package: str) -> None:
    if find_spec(package) is None:
        raise ImportError(f"environments need {package}: pip install 'symaware-cli[rl]'", name=package)


def _view(render_mode: str | None, connect: str | None) -> EpisodeView | None:
    """Return the view of a render mode; None if the mode has none."""
    if render_mode not in (None, "rgb_array", "human"):
        raise ValueError(f"the render mode {render_mode!r} is neither rgb_array nor human")
    if render_mode != "human":
        if connect is not None:
            raise ValueError("a viewer is for the render mode human")
        return None
    from symaware_cli.learning.episode_view import EpisodeView

    return EpisodeView(connect)


_register()
