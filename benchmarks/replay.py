"""Benchmark of replays: ``python replay.py CASE [--row-by-row]`` prints figures as JSON.

A case is a run: *ten* has ten agents for 2,000 steps, each with a state, an intent, a risk, a control input and beliefs
about the nine others at every step; *crossing* and *circle-swap* are the scenarios of these names; *large* is the run
of 10,000 agents over 1,000 steps whose memory benchmarks/ours.py measures, a log of more than a gigabyte.

It measures the CPU time from the log to the .rrd file, without start-up: a short replay is made first. An update is one
row of awareness, control or knowledge of one agent at one instant, as in the summary of a run.

With ``--row-by-row``, each update is one `rr.log` of a point, a line or a number, which draws less than the replay
does. As this takes long, only the beginning of the log is converted; the time per update is compared.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import ours

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import Log, open_log, others_message, wire
from symaware_cli.views import GroupView, RunView
from symaware_cli.views.replay_session import replay_session
from symaware_cli.views.rerun.columns import TIMELINE
from symaware_cli.views.scene.others import read_beliefs
from symaware_cli.views.viewer import require
from symaware_cli.views.views import run_view_of

SCENARIOS = Path(__file__).parent.parent / "scenarios"

TEN = """
symaware: 1
name: ten
seed: 1
run: {duration: 100.0}
environment: {use: kinematic, with: {time_step: 0.05}}
agents:
  robot:
    count: 10
    entity: {shape: {circle: {radius: 0.3}}}
    model: {use: unicycle, with: {max_speed: 1.5}}
    state: {circle: {radius: 50.0}}
    knowledge: {goal: {circle: {radius: 50.0, phase: 3.141592653589793}}}
    components:
      sense: {use: perception.range, with: {range: 200.0, position_noise: 0.05, self_noise: 0.02}}
      fear: {use: risk.time-to-collision, with: {horizon: 3.0, reach: 5.0}}
      steer: {use: control.go-to-goal, with: {speed: 0.9}}
"""

#: Share of a log that is drawn row by row.
_SAMPLE = 0.05


def recorded(case: str, folder: Path) -> tuple[Path, int]:
    """Make the run of a case; return its log and the number of updates."""
    scenario = SCENARIOS / f"{case}.yaml"
    if case == "large":
        scenario = folder / "large.yaml"
        scenario.write_text(ours.scenario("risk", 10_000, 1_000))
    if case == "ten":
        scenario = folder / "ten.yaml"
        scenario.write_text(TEN)
    log = folder / f"{case}.mcap"
    return log, execute(build(scenario), log).updates


def convert(log: Path, path: Path) -> float:
    """Return the CPU time of writing an .rrd file [s]."""
    started = time.process_time()
    replay_session(open_log(log)).save(path)
    return time.process_time() - started


def convert_row_by_row(log: Log, path: Path) -> tuple[float, int]:
    """Log the beginning of a log with one `rr.log` per update; return the CPU time [s] and the number of updates."""
    import rerun as rr

    run_view = run_view_of(log)
    recording = rr.RecordingStream("benchmark")
    recording.save(path)
    updates = 0
    started = time.process_time()
    for message in log.messages(end=int((log.end_time or 0) * _SAMPLE)):
        _, root, group, field = f"{message.channel.topic}///".split("/")[:4]
        if root != "agents":
            continue
        group_view, content = run_view.group_views[group], message.decode()
        recording.set_time(TIMELINE, duration=np.timedelta64(message.time, "ns"))
        for row, drawn in _drawn(rr, run_view, group_view, field, content):
            recording.log(f"{group_view.agents[row]}/{field}", drawn)
            updates += 1
    recording.flush()
    recording.disconnect()
    return time.process_time() - started, updates


def _drawn(rr: Any, run_view: RunView, group_view: GroupView, field: str, content: Any) -> Iterator[tuple[int, Any]]:
    """Yield the Rerun archetype to log for each row of a message."""
    match content:
        case wire.Rows() if field == "control":
            for row, control_input in enumerate(content.values):
                yield row, rr.Scalars(control_input)
        case wire.Rows():
            for row, state in enumerate(content.values):
                yield (
                    row,
                    rr.Points3D(group_view.positions(state), colors=group_view.colours[row], radii=group_view.radius),
                )
        case wire.SeriesRows():
            for row, (_, values) in enumerate(content):
                if field == "risk":
                    yield row, rr.Scalars(values[0])
                else:
                    yield row, rr.LineStrips3D([group_view.positions(values)], colors=group_view.colours[row])
        case others_message.Awareness() if not content.world:
            beliefs = read_beliefs([(0, content)], len(group_view.agents), range(len(group_view.agents)), 2)
            for row in range(len(group_view.agents)):
                yield row, rr.Points3D(beliefs.places[beliefs.observer == row])


def main() -> None:
    """Measure the case given on the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=["ten", "crossing", "circle-swap", "large"])
    parser.add_argument("--row-by-row", action="store_true")
    arguments = parser.parse_args()
    require()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, updates = recorded(arguments.case, folder)
        warm, _ = recorded("head-on", folder)
        convert(warm, folder / "warm.rrd")
        if arguments.row_by_row:
            convert_row_by_row(open_log(warm), folder / "warm.rrd")
            cpu, updates = convert_row_by_row(open_log(log), folder / "rows.rrd")
        else:
            cpu = convert(log, folder / "columns.rrd")
        size = log.stat().st_size
    # This includes the run that made the log, which needs less memory.
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps({"cpu": cpu, "updates": updates, "peak_memory": peak, "log_size": size}))


if __name__ == "__main__":
    main()
