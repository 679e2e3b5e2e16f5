"""The scenario tree: what somebody may do whose intent is known, but who may turn otherwise for a while."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: What the third branch of the tree is; see `ScenarioTree`.
ThirdBranch = Literal["paper", "recorded"]

_BRANCHES = 3


class ScenarioTree:
    """All sequences of three turn rates over the robust horizon, after which the intent goes on.

    Scenario j picks, at step i of the robust horizon, by the digit i of j to the base 3: the greatest turn rate to the
    left, the same to the right, or the third branch. With a robust horizon of 0, the intent is the only scenario.

    Attributes:
        steps: The horizon N.
        robust_steps: The robust horizon, in steps.
        max_turn_rate: What the branches turn with [rad/s].
        third_branch: ``paper``: the turn rate of the intent. ``recorded``: straight on; then the intent itself is one
            scenario more, the last, and the others do not count at the end of the horizon, as in the published runs.
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
        #: Which branch each scenario takes at each step of the robust horizon.
        self._digits = j // _BRANCHES ** np.arange(self.robust_steps) % _BRANCHES
        apart = third_branch == "recorded" and self.robust_steps > 0
        self.count = branches + apart
        at_end = np.full(self.count, not apart)
        at_end[-1] = True
        self.counting = np.ones(self.count, bool), at_end

    def turn_rates(self, intended: ArrayLike) -> Array:
        """The turn rates of all scenarios.

        Args:
            intended: What the intent asks for in each step [rad/s]; shape (N,).

        Returns:
            In rad/s; shape (M, N).
        """
        rates = np.tile(np.asarray(intended, float), (self.count, 1))
        robust = rates[: len(self._digits), : self.robust_steps]
        robust[self._digits == 0] = self.max_turn_rate
        robust[self._digits == 1] = -self.max_turn_rate
        if self.third_branch == "recorded":
            robust[self._digits == 2] = 0.0
        return rates
