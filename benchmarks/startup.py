"""Benchmark of start-up: CPU time of processes, compared with ``python -c pass`` and with the import of libraries.

``python benchmarks/startup.py [--rounds N] [--against FOLDER]`` measures each command once per round, in turn, so that
a temporary slowdown of the machine affects all of them, and prints the least time, and the medians of the ratios over
the rounds. ``--against`` also measures the package of another checkout.

What other packages cost alone is measured, too: no verb can be faster. ``BOUND`` parses a path with Typer, reads YAML,
and validates it by a model of one field; with ``--record`` it also imports what writes logs.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

SCENARIO = Path(__file__).parent.parent / "scenarios" / "head-on.yaml"
PROGRAM = [sys.executable, "-P", "-m", "symaware_cli"]
BOUND = """
import gc, os, sys
gc.set_threshold(200_000)
os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"
from pathlib import Path
from typing import Annotated
import typer
application = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)
@application.command()
def read(path: Annotated[Path, typer.Argument()], record: bool = False):
    import numpy, yaml
    from pydantic import BaseModel
    class Document(BaseModel):
        name: str
    Document.model_validate(yaml.load(path.read_text(), yaml.CSafeLoader))
    if record:
        import google.protobuf.descriptor_pb2, mcap.writer, zstandard
try:
    application()
finally:
    gc.freeze()
"""
VERSIONS = """
import time, symaware_cli.core
from symaware_cli.language.versions import versions
for name in ("first", "again"):
    began = time.process_time()
    versions()
    print(time.process_time() - began)
"""


def cpu_time(line: list[str], package: str | None = None) -> float:
    """Run a process; return its user and system time, including children [s].

    Args:
        line: Its command line.
        package: The folder with the package; None for the installed one.
    """
    environment = {**os.environ, **({} if package is None else {"PYTHONPATH": package})}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(line, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, check=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--against", help="the folder of another checkout")
    arguments = parser.parse_args()
    rounds = arguments.rounds
    # Bytecode is cached by default; without the cache, each process would compile the modules again.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    libraries = "import numpy, pydantic, yaml"
    with tempfile.TemporaryDirectory() as folder:
        log, scenario = str(Path(folder) / "head-on.mcap"), str(SCENARIO)
        subprocess.run([*PROGRAM, "run", "-q", scenario, "--output", log], check=True)
        verbs = {
            "--version": ["--version"],
            "--help": ["--help"],
            "inspect head-on": ["inspect", log],
            "validate head-on": ["validate", scenario],
            "run head-on --no-record": ["run", "-q", "--no-record", scenario],
            "run head-on": ["run", "-q", scenario, "--output", str(Path(folder) / "again.mcap")],
        }
        commands: dict[str, tuple[list[str], str | None]] = {
            "python -c pass": ([sys.executable, "-c", "pass"], None),
            libraries: ([sys.executable, "-c", libraries], None),
            "import typer, typer.rich_utils": ([sys.executable, "-c", "import typer, typer.rich_utils"], None),
            "BOUND": ([sys.executable, "-c", BOUND, scenario], None),
            "BOUND --record": ([sys.executable, "-c", BOUND, "--record", scenario], None),
        }
        for name, line in verbs.items():
            commands[name] = [*PROGRAM, *line], None
            if arguments.against:
                commands[f"{name} ({arguments.against})"] = [*PROGRAM, *line], arguments.against
        for line, package in commands.values():
            cpu_time(line, package)
        times: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(rounds):
            for name, (line, package) in commands.items():
                times[name].append(cpu_time(line, package))
    print(f"| command | CPU time, least | compared with `python -c pass` | with `{libraries}` |\n|---|---:|---:|---:|")
    for name, own in times.items():
        ratios = [
            statistics.median(one / base for one, base in zip(own, times[other], strict=True))
            for other in ("python -c pass", libraries)
        ]
        print(f"| `{name}` | {1e3 * min(own):.0f} ms | {ratios[0]:.1f} x | {ratios[1]:.2f} x |")
    taken = [
        [float(each) for each in subprocess.check_output([sys.executable, "-c", VERSIONS], text=True).split()]
        for _ in range(rounds)
    ]
    told = {
        name: round(1e3 * statistics.median(part), 2)
        for name, part in zip(("first", "again"), zip(*taken, strict=True), strict=True)
    }
    print(f"\nversions() [ms]: {json.dumps(told)}")


if __name__ == "__main__":
    main()
