"""Optimal control problems, solvers for model predictive control, quadratic programs, and plans for specifications.

The problems need CasADi (the extra ``casadi``), programs of specifications HiGHS (the extra ``milp``), the module `qp`
needs DAQP (the extra ``qp``). Import them locally where they are used, so that programs start without them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symaware_cli.planning.optimal_control.affine_predicate import (
        Affine,
        Face,
        pair_sets,
        predicate_sets,
        state_names,
    )
    from symaware_cli.planning.optimal_control.dynamics import Dynamics
    from symaware_cli.planning.optimal_control.linear_dynamics import LinearDynamics
    from symaware_cli.planning.optimal_control.mixed_integer_program import MixedIntegerProgram, MixedIntegerSolution
    from symaware_cli.planning.optimal_control.optimal_control_problem import OptimalControlProblem
    from symaware_cli.planning.optimal_control.sampled_formula import SampledFormula, sampled
    from symaware_cli.planning.optimal_control.solver import Plan, PlanDecision, Solution, Solver
    from symaware_cli.planning.optimal_control.specification_program import (
        SpecificationPlan,
        SpecificationProgram,
        margins,
    )

__all__ = [
    "Affine",
    "Dynamics",
    "Face",
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
    "pair_sets",
    "predicate_sets",
    "sampled",
    "state_names",
]

_HOMES = {
    "affine_predicate": ("Affine", "Face", "pair_sets", "predicate_sets", "state_names"),
    "dynamics": ("Dynamics",),
    "linear_dynamics": ("LinearDynamics",),
    "mixed_integer_program": ("MixedIntegerProgram", "MixedIntegerSolution"),
    "moving_boxes": ("avoid_moving_box",),
    "optimal_control_problem": ("OptimalControlProblem",),
    "sampled_formula": ("SampledFormula", "sampled"),
    "solver": ("Plan", "PlanDecision", "Solution", "Solver"),
    "specification_program": ("SpecificationPlan", "SpecificationProgram", "margins"),
}


def __getattr__(name: str) -> Any:
    """Import a name on first use, so that each needs only its own solver."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
