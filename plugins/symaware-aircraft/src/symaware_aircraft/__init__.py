"""Intent-aware collision avoidance of aircraft: Dubins paths, and a robust MPC over a scenario tree."""

from symaware_aircraft.dubins import WORDS, DubinsPath, dubins_paths, shortest_path
from symaware_aircraft.prediction import rollout
from symaware_aircraft.tree import ScenarioTree

__all__ = ["WORDS", "DubinsPath", "ScenarioTree", "dubins_paths", "rollout", "shortest_path"]
