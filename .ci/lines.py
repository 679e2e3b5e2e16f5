"""Counts the physical lines of the product by room: without tests, benchmarks, fuzzing and generated code.

`python .ci/lines.py` prints a table of rooms, and one of the features that came later than the core. With a number, the
exit status is 1 if the product without these features has more lines than that.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

TOP = Path(__file__).parents[1]
PACKAGE = TOP / "symaware_cli"
KINDS = {".py", ".pyi", ".js", ".css", ".html"}
#: The floors below the features, with the stock of models and components.
CORE = {"core", "awareness", "world", "geometry", "specification", "assets", "engine", "language", "log"}
#: Features that came after commit 05b0ff67, by name: their folders and modules, relative to the package or the
#: repository. What they added to modules that existed before is not counted as theirs.
LATER = {
    "plugins beside a scenario, in files": (
        *("plugin_files", "language/own_plugins.py", "cli/trust.py"),
        *("core/function_controller.py", "language/inline_scenario.py"),
    ),
    "scaffolds of plugins": ("cli/plugin_package.py",),
    "conformance kit": ("testing",),
    "data frames": ("log/data_frames.py", "api/sweep_result.py"),
    "templates of groups, parameters of one agent": (
        *("language/group_templates.py", "language/merge_patch.py", "language/own_parameters.py"),
        "engine/runtime/held_rows.py",
    ),
    "MuJoCo": (
        *(
            "plugins/symaware-mujoco",
            "assets/mjcf.py",
            "assets/mjcf_defaults.py",
            "assets/mjcf_inclusion.py",
            "assets/mjcf_looks.py",
            "assets/mjcf_pose.py",
            "assets/convexity.py",
            "worlds/hull_check.py",
        ),
        *("worlds/vehicles.py", "worlds/bullet_vehicles.py", "worlds/colours.py", "worlds/ground.py"),
        "language/capable_worlds.py",
    ),
    "robots from files": (
        *("assets/mechanism.py", "assets/robot_joint.py", "engine/models/articulated.py", "engine/models/wheeled.py"),
        *("engine/models/robot_file.py", "engine/models/robot_links.py", "evidence/link_here.py"),
        *("engine/components/control/schedule.py", "engine/environments/looks_check.py"),
    ),
    "maps and planners": (
        *("maps", "views/scene/areas.py", "language/free_places.py", "planning/control/mpc_surfaces.py"),
        *("engine/components/control/timed_waypoints.py", "engine/environments/contact_response.py"),
    ),
    "driving by a lidar": (
        *("engine/components/scan_surfaces.py", "engine/components/control/scan_steering.py"),
        *("engine/components/control/dynamic_window.py", "engine/components/control/free_direction.py"),
        "engine/components/control/vector_field_histogram.py",
    ),
    "roads": ("roads",),
    "learning": ("learning", "engine/runtime/state/state_mark.py", "views/world_frame.py"),
    "explanations": (
        *("evidence/causes", "cli/explain.py", "evidence/report/sections/explanation_section.py"),
        *("engine/faults/believe.py", "engine/faults/deliver.py", "engine/faults/prevent.py"),
    ),
    "contracts, budgets, switch": (
        *("evidence/contracts_section.py", "specification/awareness_scope.py", "evidence/budgeting.py"),
        *("evidence/severity_grid.py", "studies/claim_term.py", "cli/budget.py", "planning/control/switch.py"),
    ),
    "assurance cases": ("evidence/assurance", "cli/assure.py", "views/pages/templates/case.html"),
    "promises": (
        *("promises", "engine/runtime/restraint.py", "specification/further_names.py", "core/confinement.py"),
        *("engine/components/risk/risk_map.py", "evidence/report/sections/promise_facts.py"),
    ),
    "results for continuous integration": (
        *("evidence/results", "results.py", "cli/result_files.py", "evidence/tolerances.py"),
        *("cli/doctor.py", "cli/self_test.py"),
    ),
    "index of a folder of runs": (
        *("evidence/report/folder_index.py", "views/pages/templates/folder_index.html"),
        "views/pages/templates/folder_index.css",
    ),
    "bags and nodes of ROS 2": ("bags", "plugins/symaware-ros", "core/external_inputs.py", "views/postures.py"),
    "FMI": ("fmi", "world/step_simulator.py"),
    "videos": ("views/video",),
    "labels, scales, modes, figures for papers": (
        *("views/label_layout.py", "views/rerun/labels.py", "views/scale_bar.py", "cli/folding.py"),
        *("views/plotting/mode_timeline.py", "views/plotting/paper_preset.py", "views/plotting/pgf_file.py"),
    ),
}


def is_counted(file: Path) -> bool:
    """Whether a file is part of the product, and written by people."""
    return file.suffix in KINDS and not file.stem.endswith("_pb2") and file.name != "verb_summaries.py"


def files_of(place: str) -> list[Path]:
    """The files of the product in a folder or module of `LATER`."""
    if place.startswith("plugins/"):
        found = TOP / place / "src"
    else:
        found = PACKAGE / place
    if not found.exists():
        raise SystemExit(f"LATER names {place}, which does not exist")
    return [file for file in ([found] if found.is_file() else found.rglob("*")) if is_counted(file)]


def lines_in(file: Path) -> int:
    """The number of lines of a file."""
    return len(file.read_text(encoding="utf-8").splitlines())


def room_of(file: Path) -> str:
    """The room of the package or the plugin that a file belongs to."""
    if file.is_relative_to(PACKAGE):
        place = file.relative_to(PACKAGE).parts
        return place[0] if len(place) > 1 else "(public modules)"
    return "/".join(file.relative_to(TOP).parts[:2])


def main() -> int:
    """Print the tables."""
    product = [file for file in PACKAGE.rglob("*") if is_counted(file)]
    product += [file for source in (TOP / "plugins").glob("*/src") for file in source.rglob("*") if is_counted(file)]
    later: Counter[str] = Counter()
    features: Counter[str] = Counter()
    for feature, places in LATER.items():
        for file in (file for place in places for file in files_of(place)):
            later[room_of(file)] += lines_in(file)
            features[feature] += lines_in(file)
    lines: Counter[str] = Counter()
    for file in product:
        lines[room_of(file)] += lines_in(file)
    print("   lines    later     rest  room")
    for room, count in lines.most_common():
        print(f"{count:8,} {later[room]:8,} {count - later[room]:8,}  {room}")
    print()
    for feature, count in features.most_common():
        print(f"         {count:8,}           {feature}")
    print()
    below, below_later = (sum(each[room] for room in CORE) for each in (lines, later))
    print(f"{below:8,} {below_later:8,} {below - below_later:8,}  engine, language, log and the stock catalogue")
    whole, whole_later = lines.total(), later.total()
    print(f"{whole:8,} {whole_later:8,} {whole - whole_later:8,}  product")
    return int(len(sys.argv) > 1 and whole - whole_later > int(sys.argv[1]))


if __name__ == "__main__":
    sys.exit(main())
