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

    from symaware_cli.learning.parallel_environment import ScenarioParallelEnv
    from symaware_cli.learning.single_environment import ScenarioEnv
    from symaware_cli.learning.team_vector_environment import ScenarioTeamVectorEnv
    from symaware_cli.learning.vector_environment import ScenarioVectorEnv

#: The name of the environment in Gymnasium.
ID = "symaware/Scenario-v0"

#: What the section `learning` says, or a function of a `Team`.
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
) -> ScenarioParallelEnv:
    """Return a scenario as a parallel environment of PettingZoo.

    Each argument from `agents` to `terminate` replaces what the section `learning` of the scenario says.

    Args:
        scenario: A scenario file, a log, or a `Scenario`.
        agents: The agents that learn: a group, an agent, or several of these. Components drive all others.
        observation: As in the section, or a function of a `Team` that returns shape (n,) or (n, k).
        action: The bounds ``low`` and ``high`` of the actions, which are control inputs.
        reward: As in the section, or a function of a `Team` that returns shape (n,).
        terminate: As in the section, or a function of a `Team` that returns shape (n,).
        changes: Values that replace those of the file, by their paths.
        render_mode: ``rgb_array``, or None.

    Raises:
        ScenarioError: The scenario has problems; each is located.
        LearningError: Nothing says which agents learn, or a function returns something else.
        ImportError: PettingZoo is not installed.

    Warns:
        ProcessorWarning: See `Scenario.run`.
    """
    _require("pettingzoo", render_mode)
    processor.warn_once(stacklevel=2)
    from symaware_cli.learning.parallel_environment import ScenarioParallelEnv

    return ScenarioParallelEnv(
        _episodes(scenario, agents, observation, action, reward, terminate, changes), render_mode
    )


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

    Raises:
        ScenarioError: See `env`.
        LearningError: See `env`; or several agents learn.
        ImportError: Gymnasium is not installed.

    Warns:
        ProcessorWarning: See `Scenario.run`.
    """
    _require("gymnasium", render_mode)
    processor.warn_once(stacklevel=2)
    from symaware_cli.learning.single_environment import ScenarioEnv

    episodes = _episodes(scenario, agent, observation, action, reward, terminate, changes)
    ids = [id for team in episodes.teams for id in team.agents]
    if len(ids) > 1:
        episodes.close()
        raise _several(ids, "env")
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
) -> ScenarioVectorEnv | ScenarioTeamVectorEnv:
    """Return many rows of a scenario as one environment; each equals `single_env` or `env`, byte for byte.

    Rows are computed as arrays, as runs of a sweep are, if the scenario can be batched; otherwise each has a simulation
    of its own. The attribute `unbatched` says why.

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

    Raises:
        ScenarioError: See `env`.
        LearningError: See `env`; agents differ in the number of observed values or control inputs; or the scenario
            cannot be batched although `batched` is true.
        ValueError: There is no such mode, or no row.
        ImportError: Gymnasium is not installed.

    Warns:
        ProcessorWarning: See `Scenario.run`.
    """
    _require("gymnasium", None)
    processor.warn_once(stacklevel=2)
    if num_envs < 1:
        raise ValueError(f"a number of environments is at least 1, not {num_envs}")
    import numpy as np
    from gymnasium.vector import AutoresetMode

    from symaware_cli.learning.batched_rows import BatchedRows, refusal_of_rows
    from symaware_cli.learning.row_arrays import EpisodeSource
    from symaware_cli.learning.separate_rows import SeparateRows
    from symaware_cli.learning.team_vector_environment import ScenarioTeamVectorEnv
    from symaware_cli.learning.vector_environment import ScenarioVectorEnv
    from symaware_cli.learning.vector_episodes import VectorEpisodes

    mode = _mode(autoreset_mode, AutoresetMode)

    def make() -> Episodes:
        return _episodes(scenario, agents, observation, action, reward, terminate, changes)

    episodes = make()
    teams = episodes.teams
    if len({*episodes.widths}) > 1 or len({len(low) for low, _ in episodes.spaces}) > 1:
        said = ", ".join(
            f"`{team.group}` {width} and {len(low)}"
            for team, width, (low, _) in zip(teams, episodes.widths, episodes.spaces, strict=True)
        )
        episodes.close()
        raise LearningError(f"agents in one array have equal numbers of observed values and control inputs, not {said}")
    template = episodes.builder(None)
    reason = "it was asked for" if batched is False else refusal_of_rows(episodes, template, mixes=mixes)
    if batched and reason is not None:
        episodes.close()
        raise LearningError(f"the rows cannot be batched: {reason}")
    ids = [id for team in teams for id in team.agents]
    source: EpisodeSource
    if reason is None:
        episodes.close()
        source = BatchedRows(num_envs, len(ids), episodes, template)
    else:
        source = SeparateRows(num_envs, episodes, make)
    bounds = [
        np.concatenate(
            [np.tile(each[side], (len(team.agents), 1)) for team, each in zip(teams, episodes.spaces, strict=True)]
        )
        for side in range(2)
    ]
    rows = VectorEpisodes(source, episodes.own_seed, bounds[0].shape[1], mode)
    fps = 1.0 / episodes.time_step
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


def _episodes(
    scenario: str | os.PathLike[str] | Scenario,
    agents: str | Sequence[str] | None,
    observation: Said,
    action: Mapping[str, Any] | None,
    reward: Said,
    terminate: str | Callable[[Team], Any] | None,
    changes: Mapping[str, Any] | None,
) -> Episodes:
    """Create the episodes of a scenario, with arguments in place of what its section says."""
    said = {"agents": agents, "observation": observation, "action": action, "reward": reward, "terminate": terminate}
    if isinstance(observation, str):
        said["observation"] = [observation]
    paths = {f"learning.{key}": each for key, each in said.items() if each is not None and not callable(each)}
    functions = Functions(*(each if callable(each) else None for each in (observation, reward, terminate)))
    given = scenario if isinstance(scenario, Scenario) else Scenario(scenario)
    return Episodes(given, {**(changes or {}), **paths}, functions)


def _register() -> None:
    """Register `single_env` with Gymnasium, if it is installed."""
    if find_spec("gymnasium") is not None:
        from gymnasium.envs.registration import register, registry

        if ID not in registry:
            register(ID, f"{__name__}:single_env", vector_entry_point=f"{__name__}:single_vector_env")


def _require(package: str, render_mode: str | None) -> None:
    if find_spec(package) is None:
        raise ImportError(f"environments need {package}: pip install 'symaware-cli[rl]'", name=package)
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"the render mode {render_mode!r} is not rgb_array")


_register()
