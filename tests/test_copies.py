"""A scenario that was copied into a log or a folder is valid and runs equally without the original."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow
import pytest
import yaml
from pyarrow import parquet

import symaware_cli as sa
from symaware_cli.api.sweeps import scenario_of
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest

MESH = b"mtllib paint/red.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
LOOKS = {"paint/red.mtl": b"newmtl red\nKd 1 0 0\nmap_Kd stripes.png\n", "paint/stripes.png": b"not looked at"}
ARM = b"""<robot name="arm"><link name="a"><visual><geometry><mesh filename="package://arm/m.obj"/></geometry></visual>
</link></robot>"""
GRAPHS = {
    ".yaml": b"transitions: {hall: [hall, lab], lab: [lab, hall]}\ninitial: [hall]\n",
    ".dot": b"digraph {init -> hall; hall -> hall; hall -> lab; lab -> lab; lab -> hall;}",
}


def scenario(**sections: Any) -> bytes:
    environment = {"use": "kinematic", "with": {"time_step": 0.1}, "entities": sections.pop("entities", {})}
    robot = {
        "model": {"use": "unicycle", "with": {"process_noise": 0.1}},
        "state": [5, 0, 0],
        "components": {"see": {"use": "perception.omniscient"}, **sections.pop("components", {})},
    }
    content = {
        "symaware": 1,
        "name": "copied",
        "seed": 3,
        "run": {"duration": 0.3},
        "environment": environment,
        "agents": {"robot": robot},
        "specifications": {"near": {"each": "robot", "formula": "always norm(position) < 1"}},
        **sections,
    }
    return yaml.safe_dump(content).encode()


def thing(kind: str, file: str) -> Any:
    return {"thing": {"shape": {kind: {"file": file, "radius": 1.0}}, "position": [0, 0, 1]}}


def graph(file: str) -> Any:
    regions = {"hall": {"box": [-4, 0, -3, 3]}, "lab": {"box": [0, 9, -3, 3]}}
    return {
        "knowledge_models": {"house": {"use": "abstraction.file", "with": {"graph": {"file": file}}}},
        "regions": regions,
    }


def calibration() -> bytes:
    ahead = [0.5, 1.0]
    rows = [[{"time": time, "value": 0.01 * run * time} for time in ahead] for run in range(1, 61)]
    file = io.BytesIO()
    parquet.write_table(pyarrow.table({"prediction_error": rows}), file)
    return file.getvalue()


FORECAST = {"use": "uncertainty.conformal", "with": {"horizon": 1.0, "step": 0.5, "calibration": {"file": "e.parquet"}}}
ROBOT = {
    "share/arm/r.urdf": ARM,
    "share/arm/m.obj": MESH,
    **{f"share/arm/{name}": each for name, each in LOOKS.items()},
}

#: Files by path, where the scenario is `home/s.yaml`, by what names them.
FILES: dict[str, dict[str, bytes]] = {
    "an empty folder": {"home/s.yaml": scenario(assets=["robots"]), "home/robots/.keep": b""},
    "a folder that is not used": {"home/s.yaml": scenario(assets=["../share"]), **ROBOT},
    "a mesh": {
        "home/s.yaml": scenario(entities=thing("mesh", "in/m.obj")),
        "home/in/m.obj": MESH,
        **{f"home/in/{name}": each for name, each in LOOKS.items()},
    },
    "a mesh of a folder within": {
        "home/s.yaml": scenario(entities=thing("mesh", "m.obj"), assets=["robots"]),
        "home/robots/m.obj": MESH,
        **{f"home/robots/{name}": each for name, each in LOOKS.items()},
    },
    "a robot of a folder outside": {
        "home/s.yaml": scenario(entities=thing("urdf", "arm/r.urdf"), assets=["../share"]),
        **ROBOT,
    },
    "a robot of an absolute folder": {
        "home/s.yaml": scenario(entities=thing("urdf", "arm/r.urdf"), assets=["ROOT/share"]),
        **ROBOT,
    },
    "a package of a folder outside": {
        "home/s.yaml": scenario(entities=thing("urdf", "r.urdf"), assets=["../share"]),
        "home/r.urdf": ARM,
        **ROBOT,
    },
    "what a base names": {
        "home/s.yaml": b"extends: base/base.yaml\n",
        "home/base/base.yaml": scenario(entities=thing("urdf", "r.urdf"), assets=["../../share"]),
        "home/base/r.urdf": ARM,
        **ROBOT,
    },
    "a graph in YAML": {"home/s.yaml": scenario(**graph("in/g.yaml")), "home/in/g.yaml": GRAPHS[".yaml"]},
    "a graph in DOT": {"home/s.yaml": scenario(**graph("g.dot")), "home/g.dot": GRAPHS[".dot"]},
    "a graph of the name that logs use": {
        "home/s.yaml": scenario(**graph("resolved.yaml")),
        "home/resolved.yaml": GRAPHS[".yaml"],
    },
    "a table": {"home/s.yaml": scenario(components={"expect": FORECAST}), "home/e.parquet": calibration()},
}

Copy = Callable[[Path, Path], tuple[sa.Scenario, sa.Scenario]]


def of_a_log(path: Path, folder: Path) -> tuple[sa.Scenario, sa.Scenario]:
    log = sa.Scenario(path).run(output=folder / "log.mcap").log_path
    assert log
    return sa.Scenario(path), sa.Scenario(log)


def of_a_sweep(path: Path, folder: Path) -> tuple[sa.Scenario, sa.Scenario]:
    sa.sweep(path, folder / "sweep", runs=2, seed=7)
    copy = scenario_of(folder / "sweep", 1)
    return sa.Scenario(path, seed=copy.seed), copy


def of_a_sweep_of_a_log(path: Path, folder: Path) -> tuple[sa.Scenario, sa.Scenario]:
    log = sa.Scenario(path).run(output=folder / "log.mcap").log_path
    assert log
    _, copy = of_a_sweep(Path(log), folder)
    return sa.Scenario(path, seed=copy.seed), copy


def of_a_counterexample(path: Path, folder: Path) -> tuple[sa.Scenario, sa.Scenario]:
    sa.falsify(path, "near", folder / "out", seeds=3, runs=5)
    copy = sa.Scenario(folder / "out" / "counterexample.yaml")
    return sa.Scenario(path, seed=copy.seed), copy


def of_a_branch(path: Path, folder: Path) -> tuple[sa.Scenario, sa.Scenario]:
    of_a_log(path, folder)
    sa.branch(folder / "log.mcap", 0.1, output=folder / "branch.mcap")
    return sa.Scenario(path), sa.Scenario(folder / "branch.mcap")


COPIES: list[Copy] = [of_a_log, of_a_sweep, of_a_sweep_of_a_log, of_a_counterexample, of_a_branch]


@pytest.mark.parametrize("copied", COPIES, ids=lambda each: each.__name__)
@pytest.mark.parametrize("what", FILES)
def test_a_copy_runs_like_the_scenario(what: str, copied: Copy, tmp_path: Path) -> None:
    before = tmp_path / "before"
    for name, content in FILES[what].items():
        file = before / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content.replace(b"ROOT", str(before).encode()))
    original, copy = copied(before / "home" / "s.yaml", tmp_path)
    first = original.run(output=tmp_path / "first.mcap")
    before.rename(tmp_path / "away")
    second = copy.run(output=tmp_path / "second.mcap")
    assert digest(first.log).channels == digest(second.log).channels
    # And the copy of the copy.
    third = sa.Scenario(tmp_path / "second.mcap").run(output=tmp_path / "third.mcap")
    assert digest(second.log).combined == digest(third.log).combined
    if (tmp_path / "sweep").exists():
        assert len(sa.sweep(tmp_path / "sweep")) == 2
        assert not sa.verify_sweep(tmp_path / "sweep", "all").findings


def test_combinations_may_not_have_other_files_of_one_name(tmp_path: Path) -> None:
    """Of the two, the folder of the sweep would have one."""
    (tmp_path / "s.yaml").write_bytes(scenario(entities=thing("mesh", "m.obj")))
    for name, size in (("one", b"1"), ("two", b"2")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.obj").write_bytes(MESH.replace(b"v 1 0 0", b"v %b 0 0" % size))
    with pytest.raises(ScenarioError, match=r"the file m\.obj is another one"):
        sa.sweep(tmp_path / "s.yaml", over={"assets": [["one"], ["two"]]})
