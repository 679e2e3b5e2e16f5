"""Risk-aware dynamic task allocation: specifications with a bound of their risk, planned for with tubes."""

from symaware_warehouse.planner import Bid, Commitment, PlannedTube, Planner, Progress
from symaware_warehouse.tube import Tube

__all__ = ["Bid", "Commitment", "PlannedTube", "Planner", "Progress", "Tube"]
