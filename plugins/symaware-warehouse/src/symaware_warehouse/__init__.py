"""Risk-aware dynamic task allocation: plans with tubes for specifications with bounded risk."""

from symaware_warehouse.planner import Bid, Commitment, PlannedTube, Planner, Progress
from symaware_warehouse.tube import Tube

__all__ = ["Bid", "Commitment", "PlannedTube", "Planner", "Progress", "Tube"]
