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
    from symaware_cli.learning.parallel_environment import ScenarioParallelEnv
    from symaware_cli.learning.single_environment import ScenarioEnv

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
        raise LearningError(f"{len(ids)} agents learn: name one of {', '.join(ids[:9])}, or use `env`")
    return ScenarioEnv(episodes, render_mode)


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
            register(ID, f"{__name__}:single_env")


def _require(package: str, render_mode: str | None) -> None:
    if find_spec(package) is None:
        raise ImportError(f"environments need {package}: pip install 'symaware-cli[rl]'", name=package)
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"the render mode {render_mode!r} is not rgb_array")


_register()
