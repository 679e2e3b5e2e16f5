"""The command: `python -m fuzzing [MINUTES]`, or `.ci/fuzz [MINUTES]`."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from fuzzing.campaign import pursue, replay
from fuzzing.state import State
from fuzzing.targets import target, target_names
from fuzzing.worker import Result

CORPUS = Path("tests/corpus")


def main() -> int:
    """Fuzz, or run given cases again; return 1 if anything was found, 130 after Ctrl-C or SIGTERM."""
    asked = _arguments()
    # Without this, its workers would outlive a command that is ended.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    targets = asked.target or target_names()
    if asked.shrink:
        return _shrink(asked.shrink, targets[0])
    if asked.again or asked.corpus:
        return _try_again(asked.again, targets)
    states = {name: State.load(asked.state / name, asked.seed) for name in targets}
    status = 0
    try:
        pursue(states, minutes=asked.minutes, cases=asked.cases, jobs=asked.jobs, report=_tell)
    except KeyboardInterrupt:
        status = 130
    for name, state in states.items():
        _sum_up(name, state)
    return status or int(any(state.findings for state in states.values()))


def _arguments() -> argparse.Namespace:
    description = "Run generated input, continuing where the last call stopped."
    parser = argparse.ArgumentParser(prog=".ci/fuzz", description=description)
    parser.add_argument("minutes", nargs="?", type=float, default=10.0, help="duration in minutes (default: 10)")
    parser.add_argument("--target", action="append", choices=target_names(), help="what to fuzz (default: all targets)")
    parser.add_argument("--cases", type=int, help="number of cases of each target, including earlier ones")
    parser.add_argument("--seed", type=int, default=1, help="seed of the cases; another seed starts from the beginning")
    parser.add_argument("--jobs", type=int, default=1, help="number of worker processes (default: 1)")
    parser.add_argument("--state", type=Path, default=Path(".fuzz"), help="folder of the progress (default: .fuzz)")
    parser.add_argument("--corpus", action="store_true", help=f"run only the earlier findings in {CORPUS}")
    parser.add_argument("--again", type=Path, nargs="+", metavar="FILE", help="run these cases of one --target again")
    parser.add_argument(
        "--shrink", type=Path, nargs="+", metavar="FILE", help="make these cases of one --target small, in FILE.small"
    )
    asked = parser.parse_args()
    if (asked.again or asked.shrink) and len(asked.target or ()) != 1:
        parser.error("--again and --shrink need one --target")
    return asked


def _shrink(files: list[Path], name: str) -> int:
    """Write smaller cases with the same findings, for the corpus."""
    made = target(name)
    with tempfile.TemporaryDirectory() as prepared, tempfile.TemporaryDirectory() as folder:
        made.prepare(Path(prepared))
        for path in files:
            small = made.shrunk(path.read_bytes(), Path(folder))
            at = path.with_name(f"{path.name}.small")
            at.write_bytes(small)
            print(f"{at}  {path.stat().st_size:,} -> {len(small):,} bytes", flush=True)
    return 0


def _try_again(files: list[Path] | None, targets: list[str]) -> int:
    status = 0
    for name in targets:
        cases = files or sorted(path for path in (CORPUS / name).glob("*") if path.is_file())
        for path, result in replay(name, cases) if cases else ():
            what = f"{result.found.kind}: {result.found.text}" if result.found else _counts(result.tally)
            print(f"{path}  {result.seconds:.1f} s  {result.memory >> 20} MB  {what}", flush=True)
            status |= result.found is not None
    return status


def _tell(name: str, result: Result) -> None:
    if result.found:
        print(f"{name} {result.number}: {result.found.kind}: {result.found.where}", flush=True)


def _sum_up(name: str, state: State) -> None:
    found = sum(entry["count"] for entry in state.findings.values())
    print(
        f"\n{name}: {state.done:,} cases in {state.seconds:,.0f} s, the longest {state.longest:.1f} s, "
        f"at most {state.memory >> 20} MB more; {found} findings of {len(state.findings)} causes"
    )
    print(f"  {_counts(state.tally)}")
    for key, entry in sorted(state.findings.items(), key=lambda item: -item[1]["count"]):
        print(f"  {entry['count']:5} x {key}\n          {', '.join(entry['files'])}")


def _counts(tally: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {name}" for name, count in sorted(tally.items(), key=lambda item: -item[1]))


if __name__ == "__main__":
    sys.exit(main())
