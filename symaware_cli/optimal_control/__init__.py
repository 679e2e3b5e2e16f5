"""Optimal control: what every model predictive controller needs, over a model's own dynamics.

It needs CasADi, the extra ``casadi``. Import it where it is used, so that whatever does not use it starts without.
"""

from symaware_cli.optimal_control.dynamics import Dynamics
from symaware_cli.optimal_control.optimal_control_problem import OptimalControlProblem
from symaware_cli.optimal_control.plan import Plan, PlanDecision, Solution
from symaware_cli.optimal_control.solver import Solver

__all__ = ["Dynamics", "OptimalControlProblem", "Plan", "PlanDecision", "Solution", "Solver"]
