"""FMUs as models of agents."""

import json
import shutil
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import symaware_cli as sa
from symaware_cli.core.stateful import StateError
from symaware_cli.evidence import verify_log
from symaware_cli.fmi import fmu_process
from symaware_cli.fmi.fmu_archive import FmuError, check_archive
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.plugin_files import trusting

STEP = 0.1
INPUTS = [{"time": 0.0, "input": [1.0]}, {"time": 0.5, "input": [-5.0]}]

Write = Callable[..., Path]


@pytest.fixture
def trusted() -> Iterator[None]:
    """Trust all code."""
    with trusting():
        yield


@pytest.fixture
def scenario(tmp_path: Path, cart: Path) -> Write:
    """Write a scenario of two carts beside their FMU."""

    def write(folder: Path = cart, inputs: Any = INPUTS, states: Any = ((0, 1), (3, 2)), **changes: Any) -> Path:
        shutil.copy(folder / "Cart.fmu", tmp_path / "Cart.fmu")
        given = {
            "fmu": {"file": "Cart.fmu"},
            "state": {"x": {"unit": "m", "variable": "x"}, "y": {"unit": "m"}},
            "control_input": {"speed": {"unit": "m/s", "variable": "speed", "limit": 2.0}},
            "parameters": {"gain": 2.0},
            **changes,
        }
        document = {
            "symaware": 1,
            "name": "carts",
            "run": {"duration": 1.0},
            "environment": {"use": "kinematic", "with": {"time_step": STEP}},
            "agents": {
                "cart": {
                    "count": len(states),
                    "model": {"use": "fmu", "with": given},
                    "state": [list(state) for state in states],
                    "components": {"go": {"use": "control.schedule", "with": {"inputs": inputs}}},
                }
            },
        }
        path = tmp_path / "carts.yaml"
        path.write_text(yaml.safe_dump(document), encoding="utf-8")
        return path

    return write


def run(path: Path) -> sa.Log:
    log = path.with_suffix(".mcap")
    execute(build(path, [], None), log)
    return sa.open_log(log)


def refusal(path: Path) -> str:
    with pytest.raises(ScenarioError) as refused:
        build(path, [], None)
    (problem,) = refused.value.problems
    assert problem.span is not None
    return problem.message


@pytest.mark.usefixtures("trusted")
def test_each_agent_is_moved_by_a_separate_instance(scenario: Write) -> None:
    log = run(scenario())
    for agent, start, height in (("cart.0", 0.0, 1.0), ("cart.1", 3.0, 2.0)):
        found = log.series(agent, "world").values
        place, expected = start, [start]
        for number in range(10):
            place += 2.0 * (1.0 if number < 5 else -2.0) * STEP
            expected.append(place)
        assert found[:, 0].tolist() == pytest.approx(expected, abs=1e-12)
        assert (found[:, 1] == height).all()


@pytest.mark.usefixtures("trusted")
def test_a_run_is_repeated_and_its_log_identifies_the_fmu(scenario: Write, cart: Path) -> None:
    log = run(scenario())
    assert verify_log(log.path).difference is None
    assert log.attachments["scenario/Cart.fmu"] == (cart / "Cart.fmu").read_bytes()
    facts = json.loads(log.attachments["agents.cart.model/fmu.json"])
    assert facts["sha256"] == check_archive(cart / "Cart.fmu")
    assert facts["tool"].startswith("PythonFMU3")
    assert facts["fmi"] == "3.0"
    assert facts["fmpy"]


@pytest.mark.usefixtures("trusted")
def test_a_captured_run_continues_to_the_same_states(scenario: Write) -> None:
    with sa.load(scenario()).start() as simulation:
        simulation.step(4)
        state = simulation.capture()
        simulation.step(6)
        end = simulation.state("cart.1", "x")
        simulation.restore(sa.SimulationState.from_bytes(state.to_bytes()))
        simulation.step(6)
        assert simulation.state("cart.1", "x") == end


@pytest.mark.usefixtures("trusted")
def test_an_fmu_without_states_is_not_captured_and_named(scenario: Write, plain_cart: Path) -> None:
    with sa.load(scenario(plain_cart)).start() as simulation:
        simulation.step(2)
        with pytest.raises(StateError, match=r"Cart.fmu. has no canGetAndSetFMUState and no canSerializeFMUState"):
            simulation.capture()


def test_an_untrusted_fmu_is_not_loaded(scenario: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    def started(path: Path) -> None:
        raise AssertionError("no process may start")

    monkeypatch.setattr("symaware_cli.fmi.fmu_model.FmuProcess", started)
    monkeypatch.delenv("SYMAWARE_PLUGIN_FILES", raising=False)
    assert "is code, and it is not trusted" in refusal(scenario())


@pytest.mark.usefixtures("trusted")
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"state": {"x": {"variable": "where"}, "y": {}}}, "it has no variable `where`; it has count, gain, speed"),
        ({"control_input": {"speed": {"variable": "gain"}}}, "`gain` of `Cart.fmu` is no input"),
        ({"position": ["x", "z"]}, "`z` is no element of `state`"),
        ({"state": {"x": {"variable": "count"}, "y": {}}}, "begins with `x` = 7.0, and the scenario says 0.0"),
    ],
)
def test_missing_features_of_the_fmu_are_refused_at_their_place(
    scenario: Write, changes: dict[str, Any], said: str
) -> None:
    assert said in refusal(scenario(**changes))


@pytest.mark.usefixtures("trusted")
def test_other_worlds_are_refused_and_the_right_one_is_named(scenario: Write) -> None:
    path = scenario()
    path.write_text(path.read_text(encoding="utf-8").replace("use: kinematic", "use: pymunk"), encoding="utf-8")
    pytest.importorskip("pymunk", reason="Pymunk is an extra")
    with pytest.raises(ScenarioError) as refused:
        build(path, [], None)
    assert "kinematic" in str(refused.value)


@pytest.mark.usefixtures("trusted")
def test_an_error_of_the_fmu_ends_the_run_as_failed(scenario: Write) -> None:
    path = scenario(inputs=[{"time": 0.0, "input": [2.0]}], states=((4.5, 0),))
    execute(build(path, [], None), path.with_suffix(".mcap"))
    log = sa.open_log(path.with_suffix(".mcap"))
    assert log.outcome is not None
    assert log.outcome["status"] == "failed"
    assert "the FMU `Cart.fmu` fails at 0.1 s" in "".join(event.text + str(event.data) for event in log.events())


@pytest.mark.usefixtures("trusted")
def test_a_process_that_does_not_answer_is_ended(cart: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_process, "PATIENCE", 0.0)
    with pytest.raises(FmuError, match="did not answer within 0 s"):
        fmu_process.FmuProcess(cart / "Cart.fmu")


def archive(path: Path, *entries: tuple[str, bytes], link: str | None = None) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        for name, content in entries:
            file.writestr(name, content)
        if link is not None:
            info = zipfile.ZipInfo(link)
            info.external_attr = 0o120777 << 16
            file.writestr(info, "/etc/passwd")
    return path


@pytest.mark.parametrize(
    ("entries", "link", "said"),
    [
        ([("../evil.so", b"")], None, "leads out of it"),
        ([("/evil.so", b"")], None, "leads out of it"),
        ([("a\\..\\..\\evil.so", b"")], None, "leads out of it"),
        ([("C:/evil.so", b"")], None, "leads out of it"),
        ([("modelDescription.xml", b"")], "resources/link", "a link or a device"),
        ([("resources/a.txt", b"")], None, "there is no modelDescription.xml in it"),
        ([("modelDescription.xml", b""), ("a//b", b""), ("a/b", b"")], None, "two entries"),
    ],
)
def test_archives_are_checked_before_anything_is_unpacked(
    tmp_path: Path, entries: list[tuple[str, bytes]], link: str | None, said: str
) -> None:
    with pytest.raises(FmuError, match=said):
        check_archive(archive(tmp_path / "x.fmu", *entries, link=link))


def test_archives_that_unpack_to_too_much_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("symaware_cli.fmi.fmu_archive.MOST_UNPACKED", 1000)
    with pytest.raises(FmuError, match="unpacks to more than"):
        check_archive(archive(tmp_path / "x.fmu", ("modelDescription.xml", b" " * 2000)))


def test_files_that_are_no_archive_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.fmu").write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(FmuError, match="no sound zip archive"):
        check_archive(tmp_path / "x.fmu")
