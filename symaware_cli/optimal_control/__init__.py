"""Optimal control problems over a model's dynamics, and solvers for model predictive control.

It needs CasADi (the extra ``casadi``). Import it locally where it is used, so that programs start without it.
"""

from symaware_cli.optimal_control.dynamics import Dynamics
from symaware_cli.optimal_control.optimal_control_problem import OptimalControlProblem
from symaware_cli.optimal_control.plan import Plan, PlanDecision, Solution
from symaware_cli.optimal_control.solver import Solver

__all__ = ["Dynamics", "OptimalControlProblem", "Plan", "PlanDecision", "Solution", "Solver"]
