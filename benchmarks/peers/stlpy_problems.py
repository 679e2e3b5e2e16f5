"""stlpy: one of its problems, by its logarithmic encoding or with binary variables; prints robustness and CPU time.

The program is solved by the branch and bound of Drake (``bnb``), which is the only free solver that stlpy supports, or
by HiGHS in SciPy (``highs``), which is given the constraints that stlpy wrote.
"""

import argparse
import contextlib
import json
import resource
import sys
import time
import types

import numpy as np
import pydrake.solvers
from pydrake.symbolic import Variable
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import lil_array

# stlpy 0.3 looks for these where Drake had them in 2022.
for place in ("branch_and_bound", "all"):
    former = types.ModuleType(f"pydrake.solvers.{place}")
    vars(former).update({name: each for name, each in vars(pydrake.solvers).items() if not name.startswith("_")})
    sys.modules[former.__name__] = former

from stlpy.benchmarks import EitherOr, NarrowPassage, RandomMultitarget, ReachAvoid  # noqa: E402
from stlpy.solvers import DrakeMICPSolver, DrakeSos1Solver  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("problem", choices=["either-or", "reach-avoid", "narrow passage", "random"])
parser.add_argument("solver", choices=["bnb", "highs"])
parser.add_argument("--encoding", choices=["binary", "logarithmic"], default="logarithmic")
parser.add_argument("--steps", type=int, required=True)
parser.add_argument("--state", type=float, nargs=4, required=True)
parser.add_argument("--size", type=float, default=10.0)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--limit", type=int, default=60, help="CPU time [s]")
given = parser.parse_args()
resource.setrlimit(resource.RLIMIT_CPU, (given.limit + 5, given.limit + 6))

steps = given.steps
problem = {
    "either-or": lambda: EitherOr((7, 8, 8, 9), (6, 7, 4.5, 5.5), (1, 2, 6, 7), (3, 5, 4, 6), steps, 5),
    "reach-avoid": lambda: ReachAvoid((7, 8, 8, 9), (3, 5, 4, 6), steps),
    "narrow passage": lambda: NarrowPassage(steps),
    "random": lambda: RandomMultitarget(3, 2, 2, steps, seed=given.seed),
}[given.problem]()
kind = DrakeSos1Solver if given.encoding == "logarithmic" else DrakeMICPSolver
with contextlib.redirect_stdout(sys.stderr):
    started = time.process_time()
    specification = problem.GetSpecification()
    specification.simplify()
    solver = kind(specification, problem.GetSystem(), np.array(given.state), steps, solver="bnb", verbose=False)
    solver.AddControlBounds(np.full(2, -0.5), np.full(2, 0.5))
    solver.AddStateBounds(np.array([0, 0, -1, -1.0]), np.array([given.size, given.size, 1, 1]))
    built = time.process_time()
    status = "optimal"
    program = solver.mp
    if given.solver == "bnb":
        robustness = float(solver.Solve()[2])
    else:
        variables = program.decision_variables()
        count = len(variables)
        rows, low, high = [], [], []
        lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
        for binding in program.bounding_box_constraints():
            places = program.FindDecisionVariableIndices(binding.variables())
            lower[places] = np.maximum(lower[places], binding.evaluator().lower_bound())
            upper[places] = np.minimum(upper[places], binding.evaluator().upper_bound())
        for binding in [*program.linear_constraints(), *program.linear_equality_constraints()]:
            places = program.FindDecisionVariableIndices(binding.variables())
            matrix = binding.evaluator().GetDenseA()
            rows += [(places, row) for row in matrix]
            low += binding.evaluator().lower_bound().tolist()
            high += binding.evaluator().upper_bound().tolist()
        matrix = lil_array((len(rows), count))
        for number, (places, row) in enumerate(rows):
            for place, value in zip(places, row, strict=True):
                matrix[number, place] += value
        binary = np.array([each.get_type() == Variable.Type.BINARY for each in variables])
        lower[binary], upper[binary] = np.maximum(lower[binary], 0), np.minimum(upper[binary], 1)
        cost = np.zeros(count)
        for binding in program.linear_costs():
            cost[program.FindDecisionVariableIndices(binding.variables())] += binding.evaluator().a()
        found = milp(
            cost,
            integrality=binary.astype(int),
            bounds=Bounds(lower, upper),
            constraints=LinearConstraint(matrix.tocsr(), low, high),
            options={"time_limit": given.limit},
        )
        status = "optimal" if found.status == 0 else "infeasible" if found.status == 2 else "limit"
        robustness = float("nan") if found.x is None else -float(found.fun)
binaries = sum(each.get_type() == Variable.Type.BINARY for each in program.decision_variables())
print(
    json.dumps(
        {
            "robustness": robustness,
            "status": status,
            "build": built - started,
            "solve": time.process_time() - built,
            "binaries": binaries,
        }
    )
)
