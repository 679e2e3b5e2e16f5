"""How often `symaware explain` is right: ``python benchmarks/explain.py`` prints the shares with exact 99 % intervals.

It plants causes (a bad sensor, lost or late messages, a fault, a broken promise, in runs that without it have no
violation), and makes violations without a cause in beliefs, in which nothing is to be reported:
`tests/evidence/planted_causes.py`. The full sets take about an hour of CPU time; ``--planted``, ``--messages``,
``--faults``, ``--promises`` and ``--without`` choose fewer, the first of the same sequences.
"""

# First, so that NumPy uses the kernels with which runs repeat.
import symaware_cli  # noqa: F401, I001

import argparse
import importlib.util
import sys
import tempfile
import time
from itertools import islice
from pathlib import Path
from typing import Any

from symaware_cli.studies.statistics.interval_estimate import clopper_pearson

CASES = Path(__file__).parents[1] / "tests" / "evidence" / "planted_causes.py"


def main() -> None:
    """Explain all cases, and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planted", type=int, default=200, help="the number of cases with a bad sensor")
    parser.add_argument("--messages", type=int, default=40, help="the number of cases with lost or late messages")
    parser.add_argument("--faults", type=int, default=40, help="the number of cases with a fault")
    parser.add_argument("--promises", type=int, default=40, help="the number of cases with a broken promise")
    parser.add_argument("--without", type=int, default=400, help="the number of cases without a cause in beliefs")
    chosen = parser.parse_args()
    spec = importlib.util.spec_from_file_location("planted_causes", CASES)
    assert spec is not None
    assert spec.loader is not None
    cases: Any = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = cases
    spec.loader.exec_module(cases)
    for name, made, count in (
        ("bad sensor is first", cases.planted, chosen.planted),
        ("lost or late messages are first", cases.with_lost_messages, chosen.messages),
        ("fault is first", cases.with_faults, chosen.faults),
        ("broken promise is first", cases.with_broken_promises, chosen.promises),
        ("no cause is reported", cases.unplanted, chosen.without),
    ):
        began, right = time.process_time(), 0
        with tempfile.TemporaryDirectory() as folder:
            for case in islice(made(Path(folder)), count):
                right += cases.is_right(case, cases.explained(case))
        if not count:
            continue
        share = clopper_pearson(right, count, 0.99)
        took = time.process_time() - began
        interval = f"{share.value:.3f} [{share.lower:.3f}, {share.upper:.3f}] at 99 %"
        print(f"{name}: {right} of {count}, {interval}, {took:.0f} CPU-s", flush=True)


if __name__ == "__main__":
    main()
