"""Small tests of installed libraries, each in a process of its own, because a broken library may end its process.

``python -m symaware_cli.cli.self_test NAME [ARGUMENT]`` prints the result of one as a line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any

#: What came of a use: whether it works, a sentence, and what to do if it does not.
WORKS, MISSING, BROKEN, UNKNOWN = "works", "missing", "broken", "unknown"
Answer = tuple[str, str, str]


def world(name: str) -> Answer:
    """Make two steps in a world with one agent."""
    from symaware_cli import scenario
    from symaware_cli.language import ScenarioError

    content = {
        "symaware": 1,
        "name": "doctor",
        "run": {"duration": 0.1},
        "environment": {"use": name, "with": {"time_step": 0.05}},
        "agents": {"robot": {"entity": {"shape": {"circle": {"radius": 0.3}}}, "model": {"use": "unicycle"}}},
    }
    try:
        summary = scenario(content).run(record=False).summary
    except ScenarioError as error:
        for problem in error.problems:
            if problem.code == "missing-extra":
                return MISSING, problem.message, _command(problem.expected or "")
        said = "; ".join(problem.message for problem in error.problems)
        if any(problem.code == "broken-plugin" for problem in error.problems):
            return BROKEN, said, "install its package again"
        return UNKNOWN, f"not tried, because it does not take a circle that moves freely: {said}", ""
    return WORKS, f"{summary.steps} steps made", ""


def _command(expected: str) -> str:
    """The command in a hint such as ``the extra `pymunk`: pip install ...``."""
    return expected.partition(": ")[2]


def casadi(_: str) -> Answer:
    """Minimise (x - 2)^2 with IPOPT."""
    import casadi as library

    casadi: Any = library  # its stubs lack the version, and know options as a type of their own
    x = casadi.SX.sym("x")
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    solver = casadi.nlpsol("solver", "ipopt", {"x": x, "f": (x - 2) ** 2}, quiet)
    return _solved(float(solver(x0=0)["x"]), 2.0, f"CasADi {casadi.__version__} with IPOPT")


def highspy(_: str) -> Answer:
    """Find the greatest whole number up to 3.5 with HiGHS."""
    import highspy as library

    highspy: Any = library  # without annotations
    solver = highspy.Highs()
    solver.silent()
    number = solver.addIntegral(lb=0, ub=3.5)
    solver.maximize(number)
    return _solved(float(solver.val(number)), 3.0, f"HiGHS {solver.version()}")


def daqp(_: str) -> Answer:
    """Minimise x^2 / 2 - 2 x for x up to 1 with DAQP."""
    import daqp
    import numpy as np

    one = np.ones(1)
    found, *_rest = daqp.solve(np.eye(1), -2.0 * one, np.eye(1), one, -one, np.zeros(1, dtype=np.intc))
    return _solved(float(found[0]), 1.0, "DAQP")


def _solved(found: float, expected: float, name: str) -> Answer:
    if abs(found - expected) < 1e-6:
        return WORKS, f"{name} solved a problem with one variable", ""
    return BROKEN, f"{name} found {found:g} where the solution is {expected:g}", ""


def viewer(folder: str) -> Answer:
    """Draw the replay of a short run to a picture, which needs the viewer and a graphics driver."""
    from pathlib import Path

    from typer.testing import CliRunner

    from symaware_cli import scenario
    from symaware_cli.cli.application import application

    log, picture = Path(folder, "doctor.mcap"), Path(folder, "doctor.png")
    scenario(
        {
            "symaware": 1,
            "name": "doctor",
            "run": {"duration": 0.1},
            "environment": {"use": "kinematic"},
            "agents": {"robot": {"model": {"use": "unicycle"}}},
        }
    ).run(output=log)
    done = CliRunner().invoke(application, ["replay", str(log), "--screenshot", str(picture)])
    if done.exit_code == 0 and picture.exists():
        return WORKS, f"the replay of a run was drawn, {picture.stat().st_size:,} bytes", ""
    said = (done.stderr.strip().splitlines() or [f"exit status {done.exit_code}"])[-1].removeprefix("symaware: ")
    if "graphics driver" in said:
        remedy = "replay --web shows replays in a browser; for --screenshot: apt-get install mesa-vulkan-drivers"
        return MISSING, "the viewer is installed, and finds no screen and no Vulkan driver", remedy
    return BROKEN, said, ""


#: Each solver and viewer that is tried, with the module that it needs and the extra that installs it.
MODULES: Mapping[str, tuple[str, str, Callable[[str], Answer]]] = {
    "casadi": ("casadi", "casadi", casadi),
    "highspy": ("highspy", "milp", highspy),
    "daqp": ("daqp", "qp", daqp),
    "viewer": ("rerun", "viewer", viewer),
}


def answer(name: str, argument: str) -> Answer:
    """Try something that is installed; the name is ``world`` or one of `MODULES`."""
    if name == "world":
        return world(argument)
    module, extra, attempt = MODULES[name]
    if find_spec(module) is None:
        return MISSING, f"the module `{module}` is not installed", f"pip install 'symaware-cli[{extra}]'"
    return attempt(argument)


if __name__ == "__main__":
    print("\n" + json.dumps(answer(sys.argv[1], "".join(sys.argv[2:]))))
