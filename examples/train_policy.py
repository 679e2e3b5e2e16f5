"""Trains robots to drive to their goals, by proximal policy optimisation, and writes the policy as an ONNX file.

    python examples/train_policy.py scenarios/learned.yaml goal.onnx --without agents.robot.components.drive

Everything is in this file and in NumPy, to be read and changed. The method is that of J. Schulman, F. Wolski, P.
Dhariwal, A. Radford, O. Klimov, "Proximal policy optimization algorithms", arXiv:1707.06347, with advantages by J.
Schulman, P. Moritz, S. Levine, M. Jordan, P. Abbeel, "High-dimensional continuous control using generalized advantage
estimation", ICLR 2016. All agents that learn share one policy.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import symaware_cli as sa  # before NumPy

import numpy as np  # isort: skip
from numpy.typing import NDArray  # isort: skip

Array = NDArray[np.float64]

DISCOUNT, SMOOTHING = 0.98, 0.95
CLIP, ENTROPY, EPOCHS, BATCH = 0.2, 0.002, 6, 256
RATE, HIDDEN = 2e-3, (32, 32)


class Network:
    """Dense layers with the hyperbolic tangent between them."""

    def __init__(self, sizes: Sequence[int], last: float, random: np.random.Generator) -> None:
        scales = [*(1.0 for _ in sizes[2:]), last]
        self.parameters: list[Array] = []
        for inputs, outputs, scale in zip(sizes, sizes[1:], scales, strict=False):
            self.parameters += [random.standard_normal((inputs, outputs)) * scale / inputs**0.5, np.zeros(outputs)]

    def __call__(self, x: Array) -> Array:
        """Compute the output, shape (n, m), and keep what `gradient` needs."""
        self._inputs = [x]
        for number in range(0, len(self.parameters), 2):
            x = x @ self.parameters[number] + self.parameters[number + 1]
            if number + 2 < len(self.parameters):
                x = np.tanh(x)
            self._inputs.append(x)
        return x

    def gradient(self, error: Array) -> list[Array]:
        """Return the gradient of a loss, given that by the last output; shape (n, m)."""
        found: list[Array] = []
        for number in reversed(range(0, len(self.parameters), 2)):
            x = self._inputs[number // 2]
            found = [x.T @ error, error.sum(axis=0), *found]
            if number:
                error = (error @ self.parameters[number].T) * (1.0 - x * x)
        return found


class Adam:
    """Steps along gradients (D. P. Kingma, J. Ba, "Adam: a method for stochastic optimization", ICLR 2015)."""

    def __init__(self, parameters: list[Array]) -> None:
        self._parameters = parameters
        self._means = [np.zeros_like(each) for each in parameters]
        self._squares = [np.zeros_like(each) for each in parameters]
        self._steps = 0

    def step(self, gradients: list[Array], rate: float) -> None:
        """Change the parameters in place; the gradients together count with a norm of at most 0.5."""
        self._steps += 1
        norm = np.sqrt(sum(float((each * each).sum()) for each in gradients))
        shrink = min(1.0, 0.5 / (norm + 1e-9))
        for place, gradient, mean, square in zip(self._parameters, gradients, self._means, self._squares, strict=True):
            mean += 0.1 * (shrink * gradient - mean)
            square += 0.001 * ((shrink * gradient) ** 2 - square)
            corrected = mean / (1.0 - 0.9**self._steps)
            place -= rate * corrected / (np.sqrt(square / (1.0 - 0.999**self._steps)) + 1e-8)


class Normalisation:
    """The mean and deviation of all observations so far."""

    def __init__(self, width: int) -> None:
        self._count, self._sum, self._squares = 1e-4, np.zeros(width), np.zeros(width)

    def add(self, observations: Array) -> None:
        """Add observations, shape (n, k)."""
        self._count += len(observations)
        self._sum += observations.sum(axis=0)
        self._squares += (observations**2).sum(axis=0)

    @property
    def mean(self) -> Array:
        """The mean, shape (k,)."""
        return self._sum / self._count

    @property
    def deviation(self) -> Array:
        """The standard deviation, shape (k,)."""
        return np.sqrt(np.maximum(self._squares / self._count - self.mean**2, 1e-6))


class Samples(NamedTuple):
    """Steps of one or more episodes, in the order of agents and then time.

    Attributes:
        observations: Normalised; shape (n, k).
        actions: From -1 to 1 within the bounds, before they are clipped; shape (n, nu).
        likelihoods: The logarithms of their probability densities; shape (n,).
        advantages: By how much the actions were better than expected; shape (n,).
        returns: The discounted sums of rewards to be expected; shape (n,).
    """

    observations: Array
    actions: Array
    likelihoods: Array
    advantages: Array
    returns: Array


class Trained(NamedTuple):
    """The result of a training.

    Attributes:
        layers: Weights and bias of each layer.
        normalisation: That of observations.
        low: The least action.
        high: The greatest.
        returns: The mean return of an agent in the episodes of each iteration.
    """

    layers: list[tuple[Array, Array]]
    normalisation: Normalisation
    low: Array
    high: Array
    returns: list[float]


class Learner:
    """A policy, an estimate of returns, and how both are improved."""

    def __init__(self, observed: int, actions: int, random: np.random.Generator) -> None:
        self.random = random
        self.actor = Network([observed, *HIDDEN, actions], 0.01, random)
        self.critic = Network([observed, *HIDDEN, 1], 1.0, random)
        self.spread = np.full(actions, -0.5)  # the logarithm of the standard deviation
        self._steps = Adam([*self.actor.parameters, self.spread]), Adam(self.critic.parameters)

    def act(self, observations: Array) -> tuple[Array, Array, Array]:
        """Return random actions, their log likelihoods, and the returns that are expected."""
        mean = self.actor(observations)
        actions = mean + np.exp(self.spread) * self.random.standard_normal(mean.shape)
        return actions, self._likelihood(mean, actions), self.critic(observations)[:, 0]

    def _likelihood(self, mean: Array, actions: Array) -> Array:
        z = (actions - mean) / np.exp(self.spread)
        found: Array = -(0.5 * z * z + self.spread + 0.5 * np.log(2.0 * np.pi)).sum(axis=1)
        return found

    def improve(self, samples: Samples, rate: float) -> None:
        """Make some passes over the samples."""
        count = len(samples.observations)
        for _ in range(EPOCHS):
            order = self.random.permutation(count)
            for start in range(0, count, BATCH):
                self._step(Samples(*(each[order[start : start + BATCH]] for each in samples)), rate)

    def _step(self, batch: Samples, rate: float) -> None:
        count = len(batch.observations)
        advantages = (batch.advantages - batch.advantages.mean()) / (batch.advantages.std() + 1e-8)
        mean, deviation = self.actor(batch.observations), np.exp(self.spread)
        ratio = np.exp(self._likelihood(mean, batch.actions) - batch.likelihoods)
        # The clipped objective is constant where the ratio has gone too far in the direction of its advantage.
        moves = np.where(advantages > 0.0, ratio < 1.0 + CLIP, ratio > 1.0 - CLIP)
        by_likelihood = -np.where(moves, ratio * advantages, 0.0) / count
        z = (batch.actions - mean) / deviation
        by_mean = by_likelihood[:, None] * z / deviation
        by_spread = (by_likelihood[:, None] * (z * z - 1.0)).sum(axis=0) - ENTROPY
        self._steps[0].step([*self.actor.gradient(by_mean), by_spread], rate)
        error = self.critic(batch.observations)[:, 0] - batch.returns
        self._steps[1].step(self.critic.gradient(error[:, None] / count), rate)


def train(
    scenario: str | Path,
    iterations: int,
    seed: int = 1,
    *,
    episodes: int = 8,
    changes: dict[str, Any] | None = None,
    report: Callable[[str], None] = lambda line: None,
) -> Trained:
    """Train a policy for the agents that learn in a scenario.

    Args:
        scenario: A scenario with the section `learning`.
        iterations: How often to collect episodes and learn from them.
        seed: The seed of the episodes, and of everything random here.
        episodes: How many episodes to collect in an iteration.
        changes: Values that replace those of the scenario.
        report: Takes a line for each iteration.
    """
    environment = sa.env(scenario, changes=changes)
    agents = environment.possible_agents
    space = environment.action_space(agents[0])
    low, high = space.low.astype(float), space.high.astype(float)
    (observed,) = environment.observation_space(agents[0]).shape
    learner = Learner(observed, len(low), np.random.default_rng(seed))
    normalisation = Normalisation(observed)
    returns = []
    for iteration in range(iterations):
        collected, gained = [], []
        for episode in range(episodes):
            observations, _ = environment.reset(seed=seed if iteration == episode == 0 else None)
            steps = []
            while environment.agents == agents:
                seen = np.stack([observations[agent] for agent in agents])
                normalisation.add(seen)
                x = (seen - normalisation.mean) / normalisation.deviation
                actions, likelihoods, expected = learner.act(x)
                inputs = low + (np.clip(actions, -1.0, 1.0) + 1.0) / 2.0 * (high - low)
                observations, rewards, *_ = environment.step(dict(zip(agents, inputs, strict=True)))
                steps.append((x, actions, likelihoods, expected, np.array([rewards[agent] for agent in agents])))
            seen = np.stack([observations[agent] for agent in agents])
            last = learner.critic((seen - normalisation.mean) / normalisation.deviation)[:, 0]
            collected.append(_samples(steps, last))
            gained.append(np.sum([step[-1] for step in steps], axis=0).mean())
        rate = RATE * (1.0 - iteration / iterations)
        learner.improve(Samples(*(np.concatenate(each) for each in zip(*collected, strict=True))), rate)
        returns.append(float(np.mean(gained)))
        report(f"iteration {iteration + 1}: return {returns[-1]:.3f}")
    environment.close()
    parameters = learner.actor.parameters
    layers = list(zip(parameters[::2], parameters[1::2], strict=True))
    return Trained(layers, normalisation, low, high, returns)


def _samples(steps: Sequence[tuple[Array, ...]], last: Array) -> Samples:
    """Return the samples of an episode, whose end cuts it off: the return expected then counts."""
    observations, actions, likelihoods, expected, rewards = (np.stack(each) for each in zip(*steps, strict=True))
    advantages, following, beyond = np.zeros_like(rewards), last, np.zeros(len(last))
    for step in reversed(range(len(rewards))):
        surprise = rewards[step] + DISCOUNT * following - expected[step]
        beyond = advantages[step] = surprise + DISCOUNT * SMOOTHING * beyond
        following = expected[step]
    width, count = observations.shape[2], advantages.size
    return Samples(
        observations.reshape(count, width),
        actions.reshape(count, -1),
        likelihoods.reshape(count),
        advantages.reshape(count),
        (advantages + expected).reshape(count),
    )


def write(trained: Trained, path: str | Path) -> None:
    """Write a policy that chooses the mean action."""
    normalisation = trained.normalisation
    sa.write_policy(
        path,
        trained.layers,
        mean=normalisation.mean,
        deviation=normalisation.deviation,
        low=trained.low,
        high=trained.high,
    )


def main() -> None:
    """Train, and write the policy."""
    parser = argparse.ArgumentParser(description="Train a policy and write it as an ONNX file.")
    parser.add_argument("scenario")
    parser.add_argument("output")
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--without", metavar="PATH", help="what to leave out, such as the policy to be replaced")
    options = parser.parse_args()
    changes = {options.without: None} if options.without else {}
    write(train(options.scenario, options.iterations, options.seed, changes=changes, report=print), options.output)


if __name__ == "__main__":
    main()
