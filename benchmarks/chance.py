"""Study of `maximal_risk`: how often specifications are violated that controllers keep with a given probability.

    python benchmarks/chance.py [--runs N] [--jobs N] [SWEEP ...]

It runs the sweeps `sweeps/chance-*.yaml`, or those that are named, and prints the table of docs/risk.md. Each variant
of a sweep is a controller, so another controller is one more variant in each file. The claim of a sweep states the
maximal risk; a variant keeps it if not more runs violate the specification than do in 99 % of studies whose probability
of a violation is exactly that, and it binds if more than a quarter of that do. The exit status is 1 if a variant does
not keep it, or if a controller (`mpc` and all `mpc-...`) binds nowhere.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import yaml
from scipy.stats import beta, binom

import symaware_cli as sa
from symaware_cli.studies import Claim

TOP = Path(__file__).parents[1]


class Row(NamedTuple):
    """What became of the runs of one variant.

    Attributes:
        sweep: The sweep.
        variant: The variant.
        risk: The maximal risk.
        runs: How many runs there were.
        violated: How many violated the specification, or did not decide it.
    """

    sweep: str
    variant: str
    risk: float
    runs: int
    violated: int

    @property
    def most(self) -> int:
        """How many runs violate it at most, in 99 % of studies in which a violation has exactly the maximal risk."""
        return int(binom.ppf(0.99, self.runs, self.risk))

    @property
    def keeps(self) -> bool:
        """Whether no more did."""
        return self.violated <= self.most

    @property
    def binds(self) -> bool:
        """Whether the constraint is seen to limit the agents."""
        return self.violated > 0.25 * self.risk * self.runs

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of Clopper and Pearson of the probability of a violation, at 95 %."""
        failed, runs = self.violated, self.runs
        low = 0.0 if not failed else float(beta.ppf(0.025, failed, runs - failed + 1))
        high = 1.0 if failed == runs else float(beta.ppf(0.975, failed + 1, runs - failed))
        return low, high


def sweeps() -> Sequence[Path]:
    """The sweeps of the study."""
    return sorted((TOP / "sweeps").glob("chance-*.yaml"))


def rows(sweep: Path, runs: int | None = None, jobs: int = 0) -> Iterator[Row]:
    """Run a sweep, and yield what became of each variant.

    Args:
        sweep: The file.
        runs: Runs of each variant; those of the file by default.
        jobs: The number of worker processes; 0 for none.
    """
    claim = Claim.parse(yaml.safe_load(sweep.read_text())["claim"])
    # Fewer runs than the claim needs show something, and certify nothing.
    table = sa.sweep(sweep, runs=runs, jobs=jobs, claim=None if runs is None else "none")
    verdicts: dict[str, list[str]] = {}
    for variant, verdict in zip(
        table.column("variant").to_pylist(), table.column(f"verdict.{claim.names[0]}").to_pylist(), strict=True
    ):
        verdicts.setdefault(variant, []).append(verdict)
    for variant, found in verdicts.items():
        violated = sum(each != "satisfied" for each in found)
        yield Row(sweep.stem, variant, claim.terms[0].epsilon, len(found), violated)


def failures(found: Sequence[Row]) -> list[str]:
    """Return what contradicts the promise, and which controllers are never limited by it."""
    said = [f"{each.sweep}, {each.variant}: {each.violated} violations" for each in found if not each.keeps]
    names = sorted({each.variant for each in found}, key=len)
    controllers = [name for name in names if not any(name.startswith(f"{other}-") for other in names)]
    for name in controllers:
        own = [each for each in found if each.variant == name or each.variant.startswith(f"{name}-")]
        if not any(each.binds for each in own):
            said.append(f"{name}: the constraint binds nowhere")
    return said


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweep", nargs="*", type=Path, default=sweeps())
    parser.add_argument("--runs", type=int, help="runs of each variant; by default those of the sweep")
    parser.add_argument("--jobs", type=int, default=0, help="worker processes")
    given = parser.parse_args()
    print("| sweep | variant | `maximal_risk` | violated | interval | at most | binds |")
    print("|---|---|---:|---:|---|---:|---|")
    found = []
    for sweep in given.sweep:
        for row in rows(sweep, given.runs, given.jobs):
            low, high = row.interval
            binds = "yes" if row.binds else "no"
            print(
                f"| `{row.sweep}` | `{row.variant}` | {row.risk:g} | {row.violated} of {row.runs} |"
                f" {low:.4f} to {high:.4f} | {row.most} | {binds} |",
                flush=True,
            )
            found.append(row)
    said = failures(found)
    print("\n".join(said), end="\n" if said else "")
    return bool(said)


if __name__ == "__main__":
    sys.exit(main())
