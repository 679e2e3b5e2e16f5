"""How often `symaware explain` is right: ``python benchmarks/explain.py`` prints the shares with exact 99 % intervals.

It plants causes (a bad sensor, lost or late messages, a fault, a broken promise, in runs that without it have no
violation), and makes violations without a cause in beliefs, in which nothing is to be reported:
`tests/evidence/planted_causes.py`. The options choose how many cases of each kind, the first of the same sequences.
With ``--each`` it also prints a line for each case as soon as it is explained.
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

#: For each set its option, what is right, what yields its cases, the number of these, and what they have.
SETS = (
    ("planted", "bad sensor is first", "planted", 40, "a bad sensor"),
    ("lost", "lost messages are first", "with_lost_messages", 40, "lost messages"),
    ("late", "late messages are first", "with_late_messages", 40, "late messages"),
    ("faults", "fault is first", "with_faults", 40, "a fault"),
    ("promises", "broken promise is first", "with_broken_promises", 40, "a broken promise"),
    ("without", "no cause is reported", "unplanted", 400, "no cause in beliefs"),
)


def main() -> None:
    """Explain all cases, and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, _, _, count, what in SETS:
        parser.add_argument(f"--{name}", type=int, default=count, help=f"the number of cases with {what}")
    parser.add_argument("--each", action="store_true", help="print each case")
    chosen = parser.parse_args()
    spec = importlib.util.spec_from_file_location("planted_causes", CASES)
    assert spec is not None
    assert spec.loader is not None
    cases: Any = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = cases
    spec.loader.exec_module(cases)
    for name, result, made, _, _ in SETS:
        count = getattr(chosen, name)
        if not count:
            continue
        began, right = time.process_time(), 0
        with tempfile.TemporaryDirectory() as folder:
            for number, case in enumerate(islice(getattr(cases, made)(Path(folder)), count), 1):
                found = cases.explained(case)
                is_right = cases.is_right(case, found)
                right += is_right
                if chosen.each:
                    said = ", ".join(each.candidate.text for each in found.causes) or "none"
                    took = time.process_time() - began
                    mark = "right" if is_right else "WRONG"
                    print(f"  {name} {number} {mark}: planted {case.cause}; found {said}; {took:.0f} CPU-s", flush=True)
        share = clopper_pearson(right, count, 0.99)
        took = time.process_time() - began
        interval = f"{share.value:.3f} [{share.lower:.3f}, {share.upper:.3f}] at 99 %"
        print(f"{result}: {right} of {count}, {interval}, {took:.0f} CPU-s", flush=True)


if __name__ == "__main__":
    main()
