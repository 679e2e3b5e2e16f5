"""Benchmarks SymAware against its peers: ``python benchmarks/run.py`` prints a table and writes RESULTS.md.

Every figure is CPU time of one process, and the results are ratios of two cases in the same round: all cases run in
turn, round after round, so that a temporary slowdown of the machine affects all of them. The table shows the median and
the range of the ratios over the rounds. Peers are installed from the package index into a separate environment beside
this file; two are not in the index, and are omitted unless an interpreter is given that can import them.

With ``--against COMMIT`` the cases of SymAware are run with that commit, too, in turn with the present checkout: the
table shows how many times as fast each case is now, and nothing is written. Both run the present scripts; the commit is
installed into a temporary folder, beside the dependencies that are installed here.
"""

import argparse
import datetime
import io
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tarfile
import tempfile
import venv
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).parent

PEERS = HERE / ".peers"


@dataclass(frozen=True)
class Case:
    """A case to measure.

    Attributes:
        command: The command to run.
        whole: Whether to measure the whole process, including start-up; otherwise the command reports its own CPU time.
    """

    command: list[str]
    whole: bool = False


@dataclass(frozen=True)
class Comparison:
    """A ratio of two cases: description, how many times faster the first is than the second, and the target."""

    what: str
    one: str
    other: str
    target: str = ""


COMPARISONS = [
    Comparison("10 unicycles in Python beside IR-SIM `dash`", "dash 10", "IR-SIM 10"),
    Comparison("the same, recorded", "dash 10 recorded", "IR-SIM 10"),
    Comparison("10 unicycles, stock components, beside IR-SIM `dash`", "stock-dash 10", "IR-SIM 10", ">= 12"),
    Comparison("the same, recorded", "stock-dash 10 recorded", "IR-SIM 10"),
    Comparison("100 unicycles, stock components, beside IR-SIM `dash`", "stock-dash 100", "IR-SIM 100"),
    Comparison("a short recorded run as a whole process, beside IR-SIM", "head-on", "IR-SIM head-on"),
    Comparison("10 agents, dictionary of all, beside the original", "dictionary 10", "original aware 10", ">= 2"),
    Comparison("100 agents", "dictionary 100", "original aware 100", ">= 6"),
    Comparison("1,000 agents", "dictionary 1000", "original aware 1000", ">= 8"),
    Comparison("10 agents, shared snapshot, beside the original", "python 10", "original 10", ">= 4"),
    Comparison("100 agents", "python 100", "original 100", ">= 25"),
    Comparison("1,000 agents", "python 1000", "original 1000", ">= 300"),
    Comparison("10 agents, stock components, beside the original", "stock 10", "original 10", ">= 5"),
    Comparison("10 Python agents beside MPE2 `simple_spread`", "python 10", "MPE2 10"),
    Comparison("10 Python agents beside VMAS `navigation`, one environment", "python 10", "VMAS 10"),
    Comparison("10 quadrotors beside gym-pybullet-drones with its PID", "drones 10", "gym-drones 10", ">= 2"),
    Comparison("the same in the world `mujoco`", "drones-mujoco 10", "gym-drones 10", ">= 5"),
    Comparison("cost per agent, 10 Python agents to 1,000", "python 1000", "python 10", ">= 1"),
    Comparison("cost per agent, 1,000 unicycles with risk to 10,000", "risk 10000", "risk 1000", ">= 0.77"),
    Comparison("1,000 unicycles with risk beside bare NumPy", "risk 1000", "numpy 1000", ">= 0.5"),
    Comparison("the same, recorded", "risk 1000 recorded", "numpy 1000", ">= 0.35"),
    Comparison("10,000 unicycles with risk beside bare NumPy", "risk 10000", "numpy 10000"),
]


def _python(folder: Path) -> str:
    return str(folder / ("Scripts" if os.name == "nt" else "bin") / "python")


def install_peers() -> None:
    """Create the environment of the peers, unless it exists."""
    if not (PEERS / "installed").exists():
        venv.create(PEERS, with_pip=True, clear=True)
        wanted = ["-r", str(HERE / "peers" / "requirements.txt")]
        subprocess.run([_python(PEERS), "-m", "pip", "install", "-q", *wanted], check=True)
        (PEERS / "installed").touch()


def cases(peers: bool, original: str | None, drones: str | None, folder: Path) -> dict[str, Case]:
    """Return every case by name."""
    ours = [sys.executable, str(HERE / "ours.py")]
    found = {}
    for case, agents, steps, recorded in (
        ("python", 10, 4000, True),
        ("python", 100, 500, True),
        ("python", 1000, 400, True),
        ("dictionary", 10, 1000, False),
        ("dictionary", 100, 100, False),
        ("dictionary", 1000, 10, False),
        ("mixed", 10, 4000, True),
        ("stock", 10, 4000, True),
        ("stock", 1000, 500, True),
        ("dash", 10, 2000, True),
        ("stock-dash", 10, 2000, True),
        ("stock-dash", 100, 1000, True),
        ("risk", 1000, 500, True),
        ("risk", 10000, 50, True),
        ("numpy", 1000, 500, False),
        ("numpy", 10000, 50, False),
    ):
        command = [*ours, case, str(agents), str(steps)]
        found[f"{case} {agents}"] = Case(command)
        if recorded:
            found[f"{case} {agents} recorded"] = Case([*command, "--record"])
    program = Path(sys.executable).with_name("symaware")
    scenario = HERE.parent / "scenarios" / "head-on.yaml"
    found["head-on"] = Case([str(program), "run", str(scenario), "-o", str(folder / "head-on.mcap")], whole=True)
    found["drones 10"] = Case([*ours, "drones", "10", "300"])
    found["drones-mujoco 10"] = Case([*ours, "drones-mujoco", "10", "300"])
    if peers:
        for name, peer, arguments in (
            ("IR-SIM 10", "irsim_dash.py", ["10", "200"]),
            ("IR-SIM 100", "irsim_dash.py", ["100", "30"]),
            ("MPE2 10", "mpe2_spread.py", ["10", "200"]),
            ("VMAS 10", "vmas_navigation.py", ["10", "50"]),
        ):
            found[name] = Case([_python(PEERS), str(HERE / "peers" / peer), *arguments])
        found["IR-SIM head-on"] = Case([_python(PEERS), str(HERE / "peers" / "irsim_dash.py"), "4", "240"], whole=True)
    if original:
        script = str(HERE / "peers" / "original_symaware.py")
        for count, turns in (("10", "1000"), ("100", "100"), ("1000", "10")):
            found[f"original {count}"] = Case([original, script, count, turns])
            found[f"original aware {count}"] = Case([original, script, count, turns, "--aware"])
    if drones:
        found["gym-drones 10"] = Case([drones, str(HERE / "peers" / "gym_drones.py"), "10", "300"])
    return found


class CaseError(Exception):
    """A case does not run."""


def measure(case: Case, variables: Mapping[str, str] | None = None) -> dict[str, float]:
    """Run a case in a separate process, with further environment variables, and return its figures.

    Raises:
        CaseError: If the process fails.
    """
    # One thread each: the figures are CPU time, and NumPy's threads would only add to it.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    environment |= variables or {}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(case.command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise CaseError(f"{' '.join(case.command)} failed:\n{done.stderr}")
    if case.whole:
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return {"cpu": cpu, "agent_steps": 4 * 240}
    figures: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return figures


def installed(commit: str, folder: Path) -> dict[str, str]:
    """Install a commit into a folder, and return the environment variables with which Python imports it from there."""
    archive = subprocess.run(["git", "archive", commit], cwd=HERE.parent, capture_output=True, check=False)
    if archive.returncode:
        raise SystemExit(f"--against {commit}: {archive.stderr.decode().strip()}")
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as content:
        content.extractall(folder / "source", filter="data")
    # With its entry points, which those of the present checkout must not stand in for.
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--disable-pip-version-check"]
    subprocess.run([*pip, "--target", str(folder / "site"), str(folder / "source")], check=True)
    path = os.pathsep.join(filter(None, [str(folder / "site"), os.environ.get("PYTHONPATH")]))
    return {"PYTHONPATH": path}


def compare_with(commit: str, rounds: int, wanted: str) -> str:
    """Measure the cases whose names contain a text with a commit and with the checkout, and format the ratios."""
    ratios: dict[str, list[float]] = {}
    left_out: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _show_progress(f"installing {commit}")
        before = installed(commit, folder)
        chosen = {name: case for name, case in cases(False, None, None, folder).items() if wanted in name}
        if not chosen:
            raise SystemExit(f"--only {wanted}: no case has a name with that")
        for number in range(rounds):
            for name, case in chosen.items():
                if name in left_out:
                    continue
                _show_progress(f"round {number + 1} of {rounds}: {name}")
                rates: dict[bool, float] = {}
                # Each is the first in every second round, so that neither always runs on the warmer machine.
                for now in (True, False) if number % 2 else (False, True):
                    try:
                        figures = measure(case, {} if now else before)
                    except CaseError as error:
                        if now:
                            raise
                        left_out[name] = str(error).strip().splitlines()[-1]
                        break
                    rates[now] = figures["agent_steps"] / figures["cpu"]
                else:
                    ratios.setdefault(name, []).append(rates[True] / rates[False])
    rows = [
        f"| {name} | {min(each):.2f} | {statistics.median(each):.2f} | {max(each):.2f} |"
        for name, each in ratios.items()
    ]
    return "\n".join(
        [
            f"How many times as fast as {commit}, in {rounds} rounds (*numpy*, which uses neither, shows the noise):",
            "",
            "| case, number of agents | least | median | greatest |",
            "|---|---:|---:|---:|",
            *rows,
            *(f"\n{name} does not run with {commit}: {why}" for name, why in left_out.items()),
        ]
    )


def replays() -> dict[str, Case]:
    """Return every case of replays by name."""
    replay = [sys.executable, str(HERE / "replay.py")]
    found = {name: Case([*replay, name]) for name in ("ten", "crossing", "circle-swap")}
    return {**found, "ten, row by row": Case([*replay, "ten", "--row-by-row"])}


def _show_progress(what: str) -> None:
    print(f"\r{what:<60}", end="", file=sys.stderr, flush=True)


def measure_replays(rounds: int) -> str:
    """Measure replays, and format the results."""
    costs: dict[str, list[float]] = {}
    for number in range(rounds):
        for name, case in replays().items():
            _show_progress(f"round {number + 1} of {rounds}: replay {name}")
            figures = measure(case)
            costs.setdefault(name, []).append(1e5 * figures["cpu"] / figures["updates"])
    _show_progress("replay of a large log")
    large = measure(Case([sys.executable, str(HERE / "replay.py"), "large"]))
    faster = [slow / fast for slow, fast in zip(costs["ten, row by row"], costs["ten"], strict=True)]
    rows = [
        ("100,000 updates of ten agents to .rrd, CPU-seconds", spread(costs["ten"]), "<= 0.5"),
        ("how many times faster than `rr.log` row by row", spread(faster), ">= 20"),
        ("100,000 updates of *crossing*, CPU-seconds", spread(costs["crossing"]), ""),
        ("100,000 updates of *circle-swap*, CPU-seconds", spread(costs["circle-swap"]), ""),
    ]
    size, memory = f"{large['log_size'] / 1e9:.1f} GB", f"{large['peak_memory'] / 1e6:.0f} MB"
    return "\n".join(
        [
            "## Replays",
            "",
            "`symaware replay --save`, as `benchmarks/replay.py` measures it: *ten* agents that see each other,",
            "*crossing* with a tab for each of its twelve, *circle-swap* with tabs for four of fifty. A log of",
            f"{size}, 10,000 agents, takes {large['cpu']:.0f} CPU-seconds and {memory} at its peak.",
            "",
            f"rerun-sdk {version('rerun-sdk')}.",
            "",
            *table(rows),
            "",
        ]
    )


def measure_messages(rounds: int) -> str:
    """Measure delivered messages, and format the results."""
    lossy = "{delay: 0.02, jitter: 0.01, loss: 0.05}"
    cases = {
        "states of 1,000 agents at 10 Hz within range, with delays and losses": ["communication.py"],
        "states, recorded": ["communication.py", "--record"],
        "gossip of 1,000 agents": ["gossip.py"],
        "gossip, recorded": ["gossip.py", "--record"],
        "gossip with delays and losses": ["gossip.py", "--channel", lossy],
    }
    found: dict[str, list[float]] = {}
    for number in range(rounds):
        for name, (script, *arguments) in cases.items():
            _show_progress(f"round {number + 1} of {rounds}: {name}")
            figures = measure(Case([sys.executable, str(HERE / script), *arguments]))
            found.setdefault(name, []).append(figures["deliveries_per_cpu_second"])
    rows = [
        (
            name,
            f"{statistics.median(each):,.0f} ({min(each):,.0f} to {max(each):,.0f})",
            "" if name == "gossip with delays and losses" else ">= 200,000",
        )
        for name, each in found.items()
    ]
    about = "Deliveries per CPU-second, as `benchmarks/communication.py` and `benchmarks/gossip.py` measure them."
    return "\n".join(["## Messages", "", about, "", *table(rows), ""])


def measure_specifications(rounds: int) -> str:
    """Measure monitors of specifications, and format the results."""
    found: dict[str, list[float]] = {}
    for number in range(rounds):
        _show_progress(f"round {number + 1} of {rounds}: monitors of specifications")
        for name, nanoseconds in measure(Case([sys.executable, str(HERE / "specifications.py"), "--json"])).items():
            found.setdefault(name, []).append(nanoseconds)
    aims = {"one agent": "<= 5,000", "one agent, interval": "<= 15,000"}
    aims |= {"1,000 agents": "<= 25", "1,000 agents, interval": "<= 400"}
    rows = [(name, spread(each), aims.get(name, "")) for name, each in found.items()]
    about = [
        "Nanoseconds for each agent and instant of `always[0,5] (a implies eventually[0,2] b)` at 20 Hz, without what",
        "a and b cost, as `benchmarks/specifications.py` measures them.",
    ]
    return "\n".join(["## Specifications", "", *about, "", *table(rows), ""])


def measure_learning(rounds: int) -> str:
    """Measure environments of reinforcement learning, and format the results."""
    _show_progress("environments of reinforcement learning")
    program = [sys.executable, str(HERE / "learning.py"), "--rounds", str(rounds)]
    printed = subprocess.run(program, check=True, capture_output=True, text=True).stdout
    about = "Agent-steps per CPU-second of environments, resets included, as `benchmarks/learning.py` measures them."
    return "\n".join(["## Learning", "", about, "", printed])


def kept(before: str, text: str) -> str:
    """Return the sections of earlier results that the new ones do not have, such as those of other programs."""
    written = {section.partition("\n")[0] for section in text.split("\n## ")[1:]}
    sections = before.split("\n## ")[1:]
    return "".join(f"\n## {each.rstrip()}\n" for each in sections if each.partition("\n")[0] not in written)


def experiments() -> str:
    """Run the experiments in physics worlds, and format the results."""
    _show_progress("experiments in physics worlds")
    done = subprocess.run(
        [sys.executable, str(HERE / "experiments.py")], capture_output=True, text=True, check=False, cwd=HERE
    )
    if not done.stdout.startswith("|"):
        raise SystemExit(f"experiments.py failed:\n{done.stderr}")
    versions = ", ".join(f"{name} {version(name)}" for name in ("pymunk", "pybullet", "mujoco-core"))
    about = [
        "Errors of the physics worlds and of their bare engines at the same settings, physics steps of 2 ms, as",
        "`benchmarks/experiments.py` measures them.",
    ]
    return "\n".join(["## Experiments in physics worlds", "", *about, "", f"{versions}.", "", done.stdout])


def spread(values: list[float]) -> str:
    """Format the median and the range of values."""
    least, greatest = min(values), max(values)
    form = ".0f" if least >= 100.0 else ".2g"
    return f"{statistics.median(values):{form}} ({least:{form}} to {greatest:{form}})"


def table(rows: list[tuple[str, str, str]]) -> list[str]:
    """Format rows of description, figure and target."""
    return [
        "| what | median (least to greatest) | aim |",
        "|---|---:|---:|",
        *(f"| {a} | {b} | {c} |" for a, b, c in rows),
    ]


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-peers", action="store_true", help="measure only SymAware")
    parser.add_argument("--original", metavar="PYTHON", help="an interpreter that can import symaware.base")
    parser.add_argument("--drones", metavar="PYTHON", help="an interpreter that can import gym_pybullet_drones")
    parser.add_argument("--no-replays", action="store_true", help="omit the replays")
    parser.add_argument("--no-messages", action="store_true", help="omit the messages")
    parser.add_argument("--no-specifications", action="store_true", help="omit the monitors of specifications")
    parser.add_argument("--no-learning", action="store_true", help="omit the environments of reinforcement learning")
    parser.add_argument("--no-experiments", action="store_true", help="omit the experiments in physics worlds")
    parser.add_argument("--no-write", action="store_true", help="do not write RESULTS.md")
    parser.add_argument("--against", metavar="COMMIT", help="measure only SymAware, in turn with that of a commit")
    parser.add_argument("--only", metavar="TEXT", default="", help="with --against: the cases with this in their names")
    arguments = parser.parse_args()
    if arguments.against:
        compared = compare_with(arguments.against, arguments.rounds, arguments.only)
        print("\r" + " " * 60 + "\r", end="", file=sys.stderr)
        print(compared)
        return
    if not arguments.no_peers:
        install_peers()
    rates: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        chosen = cases(not arguments.no_peers, arguments.original, arguments.drones, Path(folder))
        for number in range(arguments.rounds):
            for name, case in chosen.items():
                _show_progress(f"round {number + 1} of {arguments.rounds}: {name}")
                figures = measure(case)
                rates.setdefault(name, []).append(figures["agent_steps"] / figures["cpu"])
    _show_progress("memory of 10,000 agents, 1,000 steps, recorded")
    ours = [sys.executable, str(HERE / "ours.py")]
    memory = measure(Case([*ours, "stock", "10000", "1000", "--record"]))
    shares = measure(Case([*ours, "risk", "1000", "300", "--record", "--profile"]))
    text = report(rates, memory, shares)
    if not arguments.no_replays:
        text += "\n" + measure_replays(arguments.rounds)
    if not arguments.no_messages:
        text += "\n" + measure_messages(arguments.rounds)
    if not arguments.no_specifications:
        text += "\n" + measure_specifications(arguments.rounds)
    if not arguments.no_learning:
        text += "\n" + measure_learning(arguments.rounds)
    if not arguments.no_experiments:
        text += "\n" + experiments()
    print("\r" + " " * 60 + "\r", end="", file=sys.stderr)
    print(text)
    if not arguments.no_write:
        results = HERE / "RESULTS.md"
        before = results.read_text(encoding="utf-8") if results.is_file() else ""
        results.write_text(text + kept(before, text), encoding="utf-8")


def _processor() -> str:
    """Return the name of the processor."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


def report(rates: dict[str, list[float]], memory: dict[str, float], shares: dict[str, float]) -> str:
    """Format the results."""
    rows = []
    for each in COMPARISONS:
        if each.one in rates and each.other in rates:
            ratios = [one / other for one, other in zip(rates[each.one], rates[each.other], strict=True)]
            rows.append((each.what, spread(ratios), each.target))
        else:
            rows.append((each.what, "not measured", each.target))
    names = ("symaware-cli", "numpy", "scipy", "zstandard")
    software = ", ".join([f"Python {platform.python_version()}", *(f"{name} {version(name)}" for name in names)])
    peers = ", ".join((HERE / "peers" / "requirements.txt").read_text().split()).replace("==", " ")
    peak, size = f"{memory['peak_memory'] / 1e6:.0f} MB", f"{memory['log_size'] / 1e6:.0f} MB"
    lines = [
        "# Results",
        "",
        "Written by `python benchmarks/run.py`, whose docstring describes the measurement. Cases of ours: *python*",
        "has perception and controller as components of single agents in plain Python; *dictionary* likewise, but",
        "each perception fills a dictionary of all agents and each controller reads it; *mixed* has the built-in",
        "perception; *stock* only built-in components; *dash* and *stock-dash* are unicycles with limits that never",
        "arrive, as those of IR-SIM; *risk* unicycles with the time to collision with their neighbours; *numpy* the",
        "same mathematics with nothing around it; *head-on* a whole process, start-up and recording included.",
        "*original* is the SymAware framework, *aware* where its controllers read what they believe of others.",
        "",
        f"{datetime.datetime.now(datetime.UTC).date()}, {_processor()} with {os.cpu_count()} cores; {software}.",
        f"Peers: {peers}.",
        "",
        "How many times as fast, in the same round:",
        "",
        *table(rows),
        "",
        f"10,000 agents, 1,000 steps, recorded, take {peak} at their peak; the log has {size}.",
        "",
        "| case, number of agents | agent-steps per CPU-second, median (least to greatest) |",
        "|---|---:|",
        *(
            f"| {name} | {statistics.median(own):,.0f} ({min(own):,.0f} to {max(own):,.0f}) |"
            for name, own in rates.items()
        ),
        "",
        "Where the time of *risk 1000 recorded* goes (under the profiler, which overstates the cost of Python):",
        "",
        *(f"- {100 * share:.0f} % {part}" for part, share in shares.items() if share >= 0.01),
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    try:
        main()
    except CaseError as failure:
        raise SystemExit(str(failure)) from None
