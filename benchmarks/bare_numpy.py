"""Baseline of the case ``risk``: the same mathematics with NumPy and SciPy alone.

Unicycles steer to their goals, and for each the time to collision with its neighbours is computed. Neighbours are found
anew at each step, or taken from a list of pairs that are a margin farther apart at most, which is made again once an
agent has moved half the margin (Verlet 1967, Phys. Rev. 159, 98).
"""

import math
import time

import numpy as np
from scipy.spatial import cKDTree


def run(agents: int, steps: int, margin: float = 0.0) -> float:
    """Perform the steps and return their CPU time [s].

    Args:
        agents: The number of agents.
        steps: The number of steps.
        margin: That of the list of neighbours [m]; 0 to find them anew at each step.
    """
    random = np.random.default_rng(1)
    side = math.sqrt(20.0 * agents)
    state = np.column_stack([random.uniform(0, side, (agents, 2)), random.uniform(-3.14, 3.14, agents)])
    goal = random.uniform(0, side, (agents, 2))
    step, reach, horizon, radius = 0.05, 3.0, 3.0, 0.2
    near, since = np.empty((0, 2), int), np.full((agents, 2), np.inf)
    started = time.process_time()
    for _ in range(steps):
        position, heading = state[:, :2], state[:, 2]
        way = goal - position
        distance = np.hypot(way[:, 0], way[:, 1])
        error = np.remainder(np.arctan2(way[:, 1], way[:, 0]) - heading + np.pi, 2 * np.pi) - np.pi
        speed = np.minimum(1.0, distance) * np.maximum(np.cos(error), 0.0)
        turn = np.clip(4.0 * error, -2.0, 2.0)
        velocity = np.column_stack([speed * np.cos(heading), speed * np.sin(heading)])
        if margin == 0 or not ((position - since) ** 2).sum(1).max() <= (margin / 2) ** 2:
            near, since = cKDTree(position).query_pairs(reach + margin, output_type="ndarray"), position
        pairs = near
        if margin:
            between = position[near[:, 0]] - position[near[:, 1]]
            pairs = near[np.einsum("ij,ij->i", between, between) <= reach * reach]
        first, second = pairs[:, 0], pairs[:, 1]
        apart, closing = position[first] - position[second], velocity[first] - velocity[second]
        a = np.einsum("ij,ij->i", closing, closing)
        b = np.einsum("ij,ij->i", apart, closing)
        c = np.einsum("ij,ij->i", apart, apart) - radius**2
        discriminant = b * b - a * c
        with np.errstate(invalid="ignore", divide="ignore"):
            until = np.where((discriminant > 0) & (b < 0), (-b - np.sqrt(discriminant)) / a, np.inf)
        danger = np.clip(1.0 - until / horizon, 0.0, 1.0)
        risk = np.zeros(agents)
        np.maximum.at(risk, first, danger)
        np.maximum.at(risk, second, danger)
        state = state + step * np.column_stack([velocity, turn])
    return time.process_time() - started
