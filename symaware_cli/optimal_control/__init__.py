"""Optimal control problems over a model's dynamics, solvers for model predictive control, and quadratic programs.

The problems need CasADi (the extra ``casadi``), the module `qp` needs DAQP instead (the extra ``qp``). Import them
locally where they are used, so that programs start without them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symaware_cli.optimal_control.dynamics import Dynamics
    from symaware_cli.optimal_control.optimal_control_problem import OptimalControlProblem
    from symaware_cli.optimal_control.plan import Plan, PlanDecision, Solution
    from symaware_cli.optimal_control.solver import Solver

__all__ = ["Dynamics", "OptimalControlProblem", "Plan", "PlanDecision", "Solution", "Solver"]

_HOMES = {
    "Dynamics": "dynamics",
    "OptimalControlProblem": "optimal_control_problem",
    "Plan": "plan",
    "PlanDecision": "plan",
    "Solution": "plan",
    "Solver": "solver",
}


def __getattr__(name: str) -> Any:
    """Import a name on first use, so that `qp` works without CasADi."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
