"""Mixed-integer programs, solved by HiGHS."""

import subprocess
import sys

SCRIPT = """
import highspy
from symaware_cli.planning.optimal_control.mixed_integer_program import MixedIntegerProgram

other = highspy.Highs()
other.silent()
other.setOptionValue("threads", 2)
other.maximize(other.addIntegral(lb=0, ub=3.5))

program = MixedIntegerProgram()
(whole,) = program.add_variables(1, 0.0, 3.5, integer=True)
program.add_cost([whole], [-1.0])
solution = program.solve()
print(solution.status, solution.values)
"""


def test_a_program_is_solved_after_other_code_of_the_process_solved_with_several_threads() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "optimal [3.]"
