"""Optimal control problems, solvers for model predictive control, quadratic programs, and plans for specifications.

The problems need CasADi (the extra ``casadi``), programs of specifications HiGHS (the extra ``milp``), the module `qp`
needs DAQP (the extra ``qp``). Import them locally where they are used, so that programs start without them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symaware_cli.optimal_control.affine_predicate import Affine, predicate_sets, state_names
    from symaware_cli.optimal_control.dynamics import Dynamics
    from symaware_cli.optimal_control.linear_dynamics import LinearDynamics
    from symaware_cli.optimal_control.mixed_integer_program import MixedIntegerProgram, MixedIntegerSolution
    from symaware_cli.optimal_control.optimal_control_problem import OptimalControlProblem
    from symaware_cli.optimal_control.plan import Plan, PlanDecision, Solution
    from symaware_cli.optimal_control.sampled_formula import SampledFormula, sampled
    from symaware_cli.optimal_control.solver import Solver
    from symaware_cli.optimal_control.specification_program import SpecificationPlan, SpecificationProgram, margins

__all__ = [
    "Affine",
    "Dynamics",
    "LinearDynamics",
    "MixedIntegerProgram",
    "MixedIntegerSolution",
    "OptimalControlProblem",
    "Plan",
    "PlanDecision",
    "SampledFormula",
    "Solution",
    "Solver",
    "SpecificationPlan",
    "SpecificationProgram",
    "avoid_moving_box",
    "margins",
    "predicate_sets",
    "sampled",
    "state_names",
]

_HOMES = {
    "Affine": "affine_predicate",
    "Dynamics": "dynamics",
    "LinearDynamics": "linear_dynamics",
    "MixedIntegerProgram": "mixed_integer_program",
    "MixedIntegerSolution": "mixed_integer_program",
    "OptimalControlProblem": "optimal_control_problem",
    "Plan": "plan",
    "PlanDecision": "plan",
    "SampledFormula": "sampled_formula",
    "Solution": "plan",
    "Solver": "solver",
    "SpecificationPlan": "specification_program",
    "SpecificationProgram": "specification_program",
    "avoid_moving_box": "moving_boxes",
    "margins": "specification_program",
    "predicate_sets": "affine_predicate",
    "sampled": "sampled_formula",
    "state_names": "affine_predicate",
}


def __getattr__(name: str) -> Any:
    """Import a name on first use, so that each needs only its own solver."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
