"""Measures SymAware beside its peers: ``python benchmarks/run.py`` prints a table and writes RESULTS.md.

Every figure is CPU time of one process, and what counts is the ratio of two figures of the same session: all cases run
in turn, round after round, so that a machine that is slow for a while is slow for all. Of the rounds the best counts.
The peers come from the package index into an environment of their own, beside this file.
"""

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
import venv
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).parent
PEERS = HERE / ".peers"
# IR-SIM twice: its version 2.10 is the one that the targets of the project were set against.
OLD_IRSIM = "ir-sim==2.10.2"


def _python(folder: Path) -> str:
    return str(folder / ("Scripts" if os.name == "nt" else "bin") / "python")


def install_peers() -> None:
    """Make the environments of the peers, unless they are there."""
    for folder, wanted in (
        (PEERS / "new", ["-r", str(HERE / "peers" / "requirements.txt")]),
        (PEERS / "old", [OLD_IRSIM]),
    ):
        if not (folder / "installed").exists():
            venv.create(folder, with_pip=True, clear=True)
            subprocess.run([_python(folder), "-m", "pip", "install", "-q", *wanted], check=True)
            (folder / "installed").touch()


def cases(peers: bool) -> dict[str, list[str]]:
    """Every case by name, as a command."""
    ours = [sys.executable, str(HERE / "ours.py")]
    found = {}
    for case, agents, steps in (
        ("python", 10, 4000),
        ("python", 100, 500),
        ("python", 1000, 400),
        ("mixed", 10, 4000),
        ("stock", 10, 4000),
        ("stock", 1000, 500),
        ("risk", 1000, 500),
        ("risk", 10000, 50),
    ):
        found[f"{case} {agents}"] = [*ours, case, str(agents), str(steps)]
        found[f"{case} {agents} recorded"] = [*ours, case, str(agents), str(steps), "--record"]
    for agents, steps in ((1000, 500), (10000, 50)):
        found[f"numpy {agents}"] = [*ours, "numpy", str(agents), str(steps)]
    if peers:
        new, old = _python(PEERS / "new"), _python(PEERS / "old")
        found["IR-SIM 2.10 10"] = [old, str(HERE / "peers" / "irsim_dash.py"), "10", "200"]
        found["IR-SIM 10"] = [new, str(HERE / "peers" / "irsim_dash.py"), "10", "200"]
        found["IR-SIM 100"] = [new, str(HERE / "peers" / "irsim_dash.py"), "100", "30"]
        found["MPE2 10"] = [new, str(HERE / "peers" / "mpe2_spread.py"), "10", "200"]
        found["VMAS 10"] = [new, str(HERE / "peers" / "vmas_navigation.py"), "10", "50"]
    return found


def replays() -> dict[str, list[str]]:
    """Every case of replays by name, as a command."""
    replay = [sys.executable, str(HERE / "replay.py")]
    cases = {name: [*replay, name] for name in ("ten", "crossing", "circle-swap")}
    return {**cases, "ten, row by row": [*replay, "ten", "--row-by-row"]}


def measure_replays(rounds: int) -> str:
    """Measure the replays, and lay out the results."""
    costs: dict[str, float] = {}
    for number in range(rounds):
        for name, command in replays().items():
            _tell(f"round {number + 1} of {rounds}: replay {name}")
            figures = measure(command)
            costs[name] = min(costs.get(name, 1.0), figures["cpu"] / figures["updates"])
    _tell("replay of a large log")
    large = measure([sys.executable, str(HERE / "replay.py"), "large"])
    targets = [
        ("100,000 updates of ten agents to .rrd, CPU-seconds", f"{1e5 * costs['ten']:.2f}", "<= 0.5"),
        ("beside `rr.log` row by row", f"{costs['ten, row by row'] / costs['ten']:.0f} x faster", ">= 20 x"),
        ("100,000 updates of *crossing*, CPU-seconds", f"{1e5 * costs['crossing']:.2f}", ""),
        ("100,000 updates of *circle-swap*, CPU-seconds", f"{1e5 * costs['circle-swap']:.2f}", ""),
        (
            f"a log of {large['log_size'] / 1e9:.1f} GB, 10,000 agents: peak memory",
            f"{large['peak_memory'] / 1e6:.0f} MB",
            "a few chunks",
        ),
        ("the same: CPU-seconds", f"{large['cpu']:.0f}", ""),
    ]
    lines = [
        "## Replays",
        "",
        "`symaware replay --save`, as `benchmarks/replay.py` measures it: *ten* agents that see each other, *crossing*",
        "with a tab for each of its twelve, *circle-swap* with tabs for four of fifty.",
        "",
        f"rerun-sdk {version('rerun-sdk')}.",
        "",
        "| what | measured | target |",
        "|---|---:|---:|",
        *(f"| {what} | {value} | {target} |" for what, value, target in targets),
        "",
    ]
    return "\n".join(lines)


def _tell(what: str) -> None:
    print(f"\r{what:<60}", end="", file=sys.stderr, flush=True)


def measure(command: list[str]) -> dict[str, float]:
    """Run a case in a process of its own."""
    # One thread each: the figures are CPU time, and NumPy's helpers would only add to it.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-peers", action="store_true", help="measure SymAware alone")
    parser.add_argument("--no-write", action="store_true", help="leave RESULTS.md as it is")
    arguments = parser.parse_args()
    if not arguments.no_peers:
        install_peers()
    commands = cases(not arguments.no_peers)
    rates: dict[str, float] = {}
    for number in range(arguments.rounds):
        for name, command in commands.items():
            _tell(f"round {number + 1} of {arguments.rounds}: {name}")
            figures = measure(command)
            rates[name] = max(rates.get(name, 0.0), figures["agent_steps"] / figures["cpu"])
    _tell("memory of 10,000 agents, 1,000 steps, recorded")
    memory = measure([sys.executable, str(HERE / "ours.py"), "stock", "10000", "1000", "--record"])
    shares = measure([sys.executable, str(HERE / "ours.py"), "risk", "1000", "300", "--record", "--profile"])
    replayed = measure_replays(arguments.rounds)
    print("\r" + " " * 60 + "\r", end="", file=sys.stderr)
    text = f"{report(rates, memory, shares)}\n{replayed}"
    print(text)
    if not arguments.no_write:
        (HERE / "RESULTS.md").write_text(text)


def _processor() -> str:
    """What the machine calls its processor."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


def report(rates: dict[str, float], memory: dict[str, float], shares: dict[str, float]) -> str:
    """Lay out the results."""

    def ratio(one: str, other: str) -> str:
        return f"{rates[one] / rates[other]:.2g} x" if one in rates and other in rates else "-"

    targets = [
        ("10 Python agents beside IR-SIM 2.10 `dash`", ratio("python 10", "IR-SIM 2.10 10"), ">= 20 x"),
        ("the same, recorded", ratio("python 10 recorded", "IR-SIM 2.10 10"), ">= 10 x"),
        ("10 Python agents beside the newest IR-SIM", ratio("python 10", "IR-SIM 10"), ">= 20 x"),
        ("the same, recorded", ratio("python 10 recorded", "IR-SIM 10"), ">= 10 x"),
        (
            "10 agents, shipped perception, Python controller, beside the newest IR-SIM",
            ratio("mixed 10", "IR-SIM 10"),
            "",
        ),
        ("10 Python agents beside MPE2 `simple_spread`", ratio("python 10", "MPE2 10"), ""),
        ("10 Python agents beside VMAS `navigation`", ratio("python 10", "VMAS 10"), ""),
        ("10 Python agents, agent-steps per CPU-second", f"{rates['python 10']:,.0f}", ">= 200,000"),
        ("cost per agent, 100 Python agents to 10", ratio("python 10", "python 100"), "<= 1"),
        ("cost per agent, 1,000 Python agents to 10", ratio("python 10", "python 1000"), "<= 1"),
        ("cost per agent, 1,000 Python agents to 100", ratio("python 100", "python 1000"), "<= 1"),
        ("1,000 unicycles with risk, agent-steps per CPU-second", f"{rates['risk 1000']:,.0f}", ">= 1,000,000"),
        ("the same, recorded", f"{rates['risk 1000 recorded']:,.0f}", ">= 700,000"),
        ("cost per agent, 10,000 unicycles to 1,000", ratio("risk 1000", "risk 10000"), "<= 1.3 x"),
        ("the same, recorded", ratio("risk 1000 recorded", "risk 10000 recorded"), ""),
        ("1,000 unicycles with risk beside bare NumPy", ratio("risk 1000", "numpy 1000"), ""),
        ("10,000 unicycles with risk beside bare NumPy", ratio("risk 10000", "numpy 10000"), ""),
        (
            "peak memory, 10,000 agents, 1,000 steps, recorded",
            f"{memory['peak_memory'] / 1e6:.0f} MB (log {memory['log_size'] / 1e6:.0f} MB)",
            "< 500 MB",
        ),
    ]
    names = ("symaware-cli", "numpy", "scipy", "zstandard")
    software = ", ".join([f"Python {platform.python_version()}", *(f"{name} {version(name)}" for name in names)])
    peers = ", ".join([*(HERE / "peers" / "requirements.txt").read_text().split(), OLD_IRSIM]).replace("==", " ")
    lines = [
        "# Results",
        "",
        "Written by `python benchmarks/run.py`, which says how it measures. Cases: *python* has perception and",
        "controller as components of single agents in plain Python; *mixed* the perception that ships; *stock* only",
        "components that ship; *risk* unicycles with the time to collision with their neighbours; *numpy* the same",
        "mathematics with nothing around it.",
        "",
        f"{datetime.datetime.now(datetime.UTC).date()}, {_processor()} with {os.cpu_count()} cores; {software}.",
        f"Peers: {peers}.",
        "",
        "The targets beside IR-SIM were set against its version 2.10; the newest is about twice as fast.",
        "",
        "| what | measured | target |",
        "|---|---:|---:|",
        *(f"| {what} | {value} | {target} |" for what, value, target in targets),
        "",
        "| case, number of agents | agent-steps per CPU-second |",
        "|---|---:|",
        *(f"| {name} | {rate:,.0f} |" for name, rate in rates.items()),
        "",
        "Where the time of *risk 1000 recorded* goes (under the profiler, which makes Python look dearer than it is):",
        "",
        *(f"- {100 * share:.0f} % {part}" for part, share in shares.items() if share >= 0.01),
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
