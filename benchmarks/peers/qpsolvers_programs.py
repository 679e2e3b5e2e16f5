"""Solves the programs of ``qp.py`` by each backend of qpsolvers that is installed, and prints its figures as JSON."""

import json
import sys
import time
import warnings

import numpy as np
import qpsolvers

warnings.simplefilter("ignore")
data = np.load(sys.argv[1])
lines = []
for backend in qpsolvers.available_solvers:
    times, apart, solved = [], 0.0, 0
    for H, f, A, upper, ours in zip(data["H"], data["f"], data["A"], data["upper"], data["solutions"], strict=True):
        began = time.perf_counter_ns()
        try:
            found = qpsolvers.solve_qp(H, f, A, upper, solver=backend)
        except Exception:  # a backend that gives up counts as one that did not solve it
            found = None
        times.append((time.perf_counter_ns() - began) / 1e3)
        if found is not None:
            solved += 1
            if np.isfinite(ours).all():
                apart = max(apart, float(np.abs(found - ours).max()))
    lines.append({"backend": backend, "median": float(np.median(times)), "solved": solved, "apart": apart})
print(json.dumps(lines))
