"""Policies with operators that onnxruntime computes: their values, refusals, and verification to a tolerance."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_scenarios import SCENARIOS
from numpy.typing import NDArray
from policy_files import dense, model, node, numbers, recurrent

import symaware_cli as sa
from symaware_cli.learning import runtime_network
from symaware_cli.learning.onnx_file import OnnxError, parse
from symaware_cli.learning.policy_network import PolicyNetwork
from symaware_cli.learning.protobuf_fields import message
from symaware_cli.learning.runtime_network import SETTINGS, RuntimeNetwork
from symaware_cli.log.log_schema import MANIFEST

Array = NDArray[np.float64]

DRIVE = "agents.robot.components.drive"


def network(content: bytes) -> RuntimeNetwork:
    return RuntimeNetwork(parse(content), content)


def convolutional() -> bytes:
    """Return a network of 6 observed values and 2 actions: a convolution, a normalisation, and attention."""
    return model(
        [
            node("LayerNormalization", ["x", "scale", "shift"], ["n"], epsilon=1e-5),
            node("Unsqueeze", ["n", "one"], ["channel"]),
            node("Conv", ["channel", "kernel"], ["c"], kernel_shape=[3]),
            node("Flatten", ["c"], ["f"]),
            node("Softmax", ["f"], ["s"], axis=1),
            node("MatMul", ["s", "w"], ["u"]),
        ],
        {
            "scale": numbers(6),
            "shift": numbers(6, seed=1),
            "one": np.array([1], "<i8"),
            "kernel": numbers(1, 1, 3, seed=2),
            "w": numbers(4, 2, seed=3),
        },
        {"x": ("n", 6)},
        ["u"],
    )


def attention(operator: str = "Softmax") -> bytes:
    """Return a network of 2 observed values and 2 actions."""
    return model([node(operator, ["x"], ["u"])], {}, {"x": ("n", 2)}, ["u"])


def test_a_network_follows_the_definitions_of_operators_that_only_the_library_has() -> None:
    x = np.random.default_rng(4).standard_normal((3, 6))
    centred = x - x.mean(axis=1, keepdims=True)
    n = centred / np.sqrt((centred**2).mean(axis=1, keepdims=True) + 1e-5) * numbers(6) + numbers(6, seed=1)
    kernel = numbers(1, 1, 3, seed=2)[0, 0]
    c = np.exp(sum(kernel[k] * n[:, k : k + 4] for k in range(3)))
    expected = (c / c.sum(axis=1, keepdims=True)) @ numbers(4, 2, seed=3)
    np.testing.assert_allclose(network(convolutional())(x)[0], expected, atol=2e-6)


@pytest.mark.parametrize("content", [dense(), recurrent(0), recurrent(1)])
def test_both_runtimes_compute_the_same_up_to_single_precision(content: bytes) -> None:
    ours, theirs = PolicyNetwork(parse(content)), network(content)
    assert (ours.observed, ours.actions, ours.states) == (theirs.observed, theirs.actions, theirs.states)
    states = ours.initial_states(7), theirs.initial_states(7)
    for instant in range(3):
        x = np.random.default_rng(instant).standard_normal((7, ours.observed))
        (one, first), (other, second) = ours(x, states[0]), theirs(x, states[1])
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)
        for mine, their in zip(first, second, strict=True):
            np.testing.assert_allclose(mine, their, atol=1e-6)
        states = first, second


@pytest.mark.parametrize("content", [convolutional(), recurrent()])
def test_the_action_of_a_row_does_not_depend_on_other_rows(content: bytes) -> None:
    found = network(content)
    x = np.random.default_rng(0).standard_normal((5, found.observed))
    together = found(x, found.initial_states(5))[0]
    for row in range(5):
        assert found(x[row : row + 1], found.initial_states(1))[0].tobytes() == together[row].tobytes()


def of(nodes: Sequence[bytes], constants: dict[str, NDArray[Any]] | None = None, version: int = 17) -> bytes:
    return model(nodes, constants or {}, {"x": ("n", 2)}, ["u"], version)


#: Of another file, as the format says it.
ELSEWHERE = message([(1, 2), (1, 2), (2, 1), (8, "w"), (13, message([(1, "location"), (2, "/etc/passwd")])), (14, 1)])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (attention()[:-9], "it is no ONNX file, or damaged: byte "),
        (
            message([(1, 8), (7, message([(5, ELSEWHERE)])), (8, message([(2, 17)]))]),
            "the constant `w` is in another file, which is not read",
        ),
        (of([node("Gelu", ["x"], ["u"], domain="com.microsoft")]), "is one of `com.microsoft`, and only operators of"),
        (attention() + message([(25, message([(1, "Softmax")]))]), "it defines functions"),
        (of([node("RandomUniformLike", ["x"], ["u"])]), "RandomUniformLike .* may draw random numbers"),
        (attention("Nope"), "onnxruntime does not compute it: .*No Op registered for Nope"),
        (of([node("Softmax", ["x"], ["u"], axis=7)]), r"'axis' must be in \[-2 , 1\]"),
        (of([node("Softmax", ["x"], ["u"])], version=30), "onnxruntime does not compute it: ONNX Runtime only "),
        (of([node("MatMul", ["x", "w"], ["u"])], {"w": numbers(3, 2)}), "onnxruntime does not compute it: .*MatMul"),
        (of([node("ReduceSum", ["x"], ["u"], keepdims=0)]), "its first output `u` has the shape .*, and an action has"),
        (of([node("ArgMax", ["x"], ["u"], axis=1)]), "onnxruntime does not compute it: Type Error: "),
        (of([node("Identity", ["x"], ["u"])]) + b"\x3a\x00", "not one graph"),
        (
            of(
                [
                    node("ConstantOfShape", ["s"], ["c"]),
                    node("ReduceSum", ["c"], ["r"], keepdims=0),
                    node("Add", ["x", "r"], ["u"]),
                ],
                {"s": np.array([2**18, 2**14], "<i8")},
            ),
            "onnxruntime does not compute it: .*ConstantOfShape.*Available memory of ",
        ),
    ],
)
def test_unsupported_networks_are_refused_with_a_message(content: bytes, said: str) -> None:
    with pytest.raises(OnnxError, match=said):
        network(content)


FUZZING = """
import random, sys
from collections import Counter
from pathlib import Path
from symaware_cli.learning.onnx_file import OnnxError
from symaware_cli.learning.runtime_network import RuntimeNetwork
content, draw, path, found = Path(sys.argv[1]).read_bytes(), random.Random(7), Path(sys.argv[2]), Counter()
for number in range(300):
    damaged = bytearray(content)
    for _ in range(draw.choice((1, 1, 2, 5))):
        damaged[draw.randrange(len(damaged))] = draw.choice((0, 1, 0x7F, 0xFF, draw.randrange(256)))
    if number % 5 == 0:
        del damaged[draw.randrange(len(damaged)) :]
    path.write_bytes(damaged)
    try:
        RuntimeNetwork.read(path, "p.onnx")
        found["computed"] += 1
    except OnnxError as error:
        assert str(error).startswith("p.onnx: "), error
        found["by the library" if "onnxruntime does not" in str(error) else "before"] += 1
print(dict(found))
"""


def test_damaged_files_do_not_end_the_process(tmp_path: Path) -> None:
    (tmp_path / "whole.onnx").write_bytes(convolutional())
    command = [sys.executable, "-c", FUZZING, str(tmp_path / "whole.onnx"), str(tmp_path / "damaged.onnx")]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = eval(done.stdout)
    assert sum(found.values()) == 300
    assert min(found[each] for each in ("computed", "by the library", "before")) > 10


def test_a_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    runtime_network._library.cache_clear()
    with pytest.raises(OnnxError, match=r"needs the module `onnxruntime`: pip install 'symaware-cli\[onnx\]'"):
        network(attention())
    runtime_network._library.cache_clear()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with learned.yaml, where a policy needs the library."""
    text = (SCENARIOS / "learned.yaml").read_text()
    (tmp_path / "policies").mkdir()
    shutil.copy(SCENARIOS / "policies" / "goal.onnx", tmp_path / "policies")
    (tmp_path / "policies" / "attention.onnx").write_bytes(attention())
    (tmp_path / "policies" / "logarithm.onnx").write_bytes(attention("Log"))
    written = text.replace("{file: policies/goal.onnx}", "{file: policies/attention.onnx, runtime: onnxruntime}")
    assert written != text
    (tmp_path / "learned.yaml").write_text(written)
    return tmp_path


def off(monkeypatch: pytest.MonkeyPatch, difference: float) -> None:
    """Let the library round as on another processor."""
    compute = RuntimeNetwork._row

    def other(self: RuntimeNetwork, given: Sequence[Array]) -> list[NDArray[Any]]:
        return [each + np.float32(difference) for each in compute(self, given)]

    monkeypatch.setattr(RuntimeNetwork, "_row", other)


def test_two_runs_on_one_machine_have_equal_bytes(folder: Path) -> None:
    for name in ("one", "other"):
        sa.load(folder / "learned.yaml").run(duration=1.0, output=folder / f"{name}.mcap")
    found = sa.verify_log(folder / "one.mcap")
    assert found.is_equal
    assert (found.tolerances, found.tolerated) == ({"agents.robot.drive": 1e-6}, 0)
    assert sa.compare(folder / "one.mcap", folder / "other.mcap").is_equal


def test_a_log_states_the_tolerance_the_settings_and_the_version(folder: Path) -> None:
    sa.load(folder / "learned.yaml").run(duration=0.2, output=folder / "run.mcap")
    files = sa.open_log(folder / "run.mcap").attachments
    assert json.loads(files[MANIFEST])["repeatable_to"] == {"agents.robot.drive": 1e-6}
    assert json.loads(files["agents.robot.drive/runtime.json"]) == SETTINGS
    versions = json.loads(files["versions.json"])
    assert {"onnxruntime", "Processor"} <= versions.keys()


@pytest.mark.parametrize(("difference", "is_equal"), [(1e-7, True), (1e-3, False)])
def test_verification_compares_to_the_stated_tolerance(
    folder: Path, monkeypatch: pytest.MonkeyPatch, difference: float, *, is_equal: bool
) -> None:
    scenario = sa.load(folder / "learned.yaml", {f"{DRIVE}.with.policy.tolerance": 2e-6})
    scenario.run(duration=1.0, output=folder / "run.mcap")
    off(monkeypatch, difference)
    found = sa.verify_log(folder / "run.mcap")
    assert found.is_equal is is_equal
    if is_equal:
        assert found.tolerated > 0
        assert found.greatest is not None
        assert 0.0 < (found.greatest.distance or 0.0) < 2e-6
    else:
        assert found.difference is not None
        assert found.writer == "agents.robot.drive"
        assert found.difference.topic == "/agents/robot/control"


def test_our_kernels_name_the_other_runtime_where_they_lack_an_operator(folder: Path) -> None:
    with pytest.raises(sa.PolicyError, match=r"Softmax .* is not supported; .*`runtime: onnxruntime` computes other"):
        sa.Policy(folder / "policies" / "attention.onnx")
    assert sa.Policy(folder / "policies" / "attention.onnx", runtime="onnxruntime")([1.0, 1.0]).tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("changes", "path", "said"),
    [
        (
            {f"{DRIVE}.with.policy": {"file": "policies/goal.onnx", "runtime": "own", "tolerance": 1e-3}},
            "policy",
            "a tolerance is for `",
        ),
        ({f"{DRIVE}.with.policy.file": "policies/nope.onnx"}, "policy.file", "onnxruntime does not compute it: "),
    ],
)
def test_a_policy_that_cannot_be_used_is_located(folder: Path, changes: dict[str, Any], path: str, said: str) -> None:
    (folder / "policies" / "nope.onnx").write_bytes(attention("Nope"))
    with pytest.raises(sa.ScenarioError, match=said) as found:
        sa.load(folder / "learned.yaml", changes).run(record=False)
    assert {each.path for each in found.value.problems} == {f"{DRIVE}.with.{path}"}


def test_an_action_that_is_not_finite_ends_the_run_at_its_component(folder: Path) -> None:
    changes = {f"{DRIVE}.with.policy.file": "policies/logarithm.onnx"}
    with pytest.raises(sa.RunFailedError, match=r"^agents\.robot\.0\.drive .* is not finite"):
        sa.load(folder / "learned.yaml", changes).run(record=False)


def test_such_runs_are_not_batched(folder: Path) -> None:
    rows = sa.vector_env(folder / "learned.yaml", 2)
    assert rows.unbatched == "`agents.robot.drive` (control.policy) repeats its results to a tolerance only"
    rows.close()


@pytest.mark.parametrize(("difference", "is_sound"), [(1e-7, True), (1e-3, False)])
def test_a_sweep_is_verified_to_the_tolerance(
    folder: Path, monkeypatch: pytest.MonkeyPatch, difference: float, *, is_sound: bool
) -> None:
    changes = {"run.duration": 0.5}
    sa.sweep(folder / "learned.yaml", folder / "sweep", changes=changes, runs=2, keep="all", jobs=1)
    off(monkeypatch, difference)
    assert sa.verify_sweep(folder / "sweep", "all").is_sound is is_sound
