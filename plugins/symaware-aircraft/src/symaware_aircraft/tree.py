"""The scenario tree: possible turn rates of an aircraft with a known intent that may deviate from it for a while."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: The third branch of the tree; see `ScenarioTree`.
ThirdBranch = Literal["paper", "recorded"]

_BRANCHES = 3


class ScenarioTree:
    """All sequences of three turn rates over the robust horizon, followed by the intent.

    In step i of the robust horizon, scenario j takes the branch given by digit i of j to the base 3: the greatest turn
    rate to the left, the same to the right, or the third branch. With a robust horizon of 0, the intent is the only
    scenario.

    Attributes:
        steps: The horizon N.
        robust_steps: The robust horizon, in steps.
        max_turn_rate: The turn rate of the first two branches [rad/s].
        third_branch: ``paper``: the turn rate of the intent. ``recorded``: straight on; then the intent itself is the
            last, additional scenario, and the other scenarios do not count at the end of the horizon, as in the
            published runs.
        count: The number of scenarios, M.
        counting: Which scenarios count at the stages 1 to N - 1, and at N; each a mask of shape (M,).
    """

    def __init__(self, steps: int, robust_steps: int, max_turn_rate: float, third_branch: ThirdBranch) -> None:
        self.steps = steps
        self.robust_steps = min(robust_steps, steps)
        self.max_turn_rate = max_turn_rate
        self.third_branch = third_branch
        branches = _BRANCHES**self.robust_steps
        j = np.arange(branches)[:, None]
        #: The branch of each scenario in each step of the robust horizon.
        self._digits = j // _BRANCHES ** np.arange(self.robust_steps) % _BRANCHES
        apart = third_branch == "recorded" and self.robust_steps > 0
        self.count = branches + apart
        at_end = np.full(self.count, not apart)
        at_end[-1] = True
        self.counting = np.ones(self.count, bool), at_end

    def turn_rates(self, intended: ArrayLike) -> Array:
        """Return the turn rates of all scenarios.

        Args:
            intended: The turn rates of the intent [rad/s]; shape (N,).

        Returns:
            The turn rates [rad/s]; shape (M, N).
        """
        rates = np.tile(np.asarray(intended, float), (self.count, 1))
        robust = rates[: len(self._digits), : self.robust_steps]
        robust[self._digits == 0] = self.max_turn_rate
        robust[self._digits == 1] = -self.max_turn_rate
        if self.third_branch == "recorded":
            robust[self._digits == 2] = 0.0
        return rates
