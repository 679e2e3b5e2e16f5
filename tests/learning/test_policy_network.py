"""Networks of policies: their values, and refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from policy_files import dense, model, node, numbers, recurrent, tensor

from symaware_cli.learning import fixed_order
from symaware_cli.learning.onnx_file import LARGEST, OnnxError, parse
from symaware_cli.learning.policy import Policy, PolicyError
from symaware_cli.learning.policy_network import PolicyNetwork
from symaware_cli.learning.policy_writing import write_policy
from symaware_cli.learning.protobuf_fields import message

Array = NDArray[np.float64]


def network(content: bytes) -> PolicyNetwork:
    return PolicyNetwork(parse(content))


def test_exponential_functions_differ_from_numpys_by_few_units_in_the_last_place() -> None:
    x = np.concatenate([np.linspace(-40.0, 40.0, 4001), [0.0, -0.0, 1e-300, 1e-9, -1e-5, 700.0, -700.0]])
    for ours, theirs in (
        (fixed_order.tangent, np.tanh),
        (fixed_order.less_one, np.expm1),
        (fixed_order.exponential, np.exp),
        (fixed_order.sigmoid, lambda x: 1.0 / (1.0 + np.exp(-x))),
    ):
        np.testing.assert_allclose(ours(x), theirs(x), rtol=1e-15)
    with np.errstate(invalid="ignore"):
        assert fixed_order.tangent(np.array([np.inf, -np.inf, 1e9])).tolist() == [1.0, -1.0, 1.0]
        assert np.isnan(fixed_order.tangent(np.array([np.nan]))).all()


def test_a_dense_network_follows_the_definitions_of_its_operators() -> None:
    x = np.random.default_rng(1).standard_normal((7, 5))
    w0, w1, w2 = (numbers(*shape).astype(float) for shape in ((16, 5), (16, 8), (16, 2)))
    hidden = np.tanh(x @ w0.T + numbers(16)) @ w1 + numbers(8)
    elu = np.where(hidden < 0.0, 0.75 * np.expm1(hidden), hidden)
    both = np.concatenate([1.0 / (1.0 + np.exp(-elu)), np.where(hidden < 0.0, 0.25 * hidden, hidden)], axis=1)
    actions, states = network(dense())(x)
    np.testing.assert_allclose(actions, np.maximum(both @ w2, -2.0), rtol=1e-12)
    assert states == ()


@pytest.mark.parametrize("resets_after", [0, 1])
def test_a_recurrent_network_follows_the_equations_of_its_unit(resets_after: int) -> None:
    w, r, b = (
        numbers(*shape, seed=seed).astype(float)[0] for shape, seed in (((1, 18, 4), 0), ((1, 18, 6), 1), ((1, 36), 2))
    )
    found = network(recurrent(resets_after))
    states, h = found.initial_states(3), np.zeros((3, 6))
    for x in np.random.default_rng(1).standard_normal((4, 3, 4)):
        actions, states = found(x, states)
        read, gate = x @ w.T + b[:18], h @ r[:12].T + b[18:30]
        z, reset = (1.0 / (1.0 + np.exp(-(read[:, k : k + 6] + gate[:, k : k + 6]))) for k in (0, 6))
        kept = reset * (h @ r[12:].T + b[30:]) if resets_after else (reset * h) @ r[12:].T + b[30:]
        h = (1.0 - z) * np.tanh(read[:, 12:] + kept) + z * h
        np.testing.assert_allclose(states[0][0], h, rtol=1e-12)
        np.testing.assert_allclose(actions, h @ numbers(2, 6, seed=3).astype(float).T, rtol=1e-12)


@pytest.mark.parametrize("content", [dense(), recurrent(0), recurrent(1)])
@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 40))
@settings(max_examples=15, deadline=None)
def test_each_row_of_a_batch_equals_that_row_alone_to_the_bit(content: bytes, seed: int, rows: int) -> None:
    found = network(content)
    random = np.random.default_rng(seed)
    x = random.standard_normal((3, rows, found.observed)) * 10.0 ** random.integers(-6, 4)
    states, alone = found.initial_states(rows), [found.initial_states(1) for _ in range(rows)]
    for each in x:
        actions, states = found(each, states)
        for row in range(rows):
            action, alone[row] = found(each[row : row + 1], alone[row])
            assert action.tobytes() == actions[row].tobytes()
            for one, several in zip(alone[row], states, strict=True):
                assert one[:, 0].tobytes() == several[:, row].tobytes()


def changed(*nodes: bytes, constants: dict[str, NDArray[Any]] | None = None, **given: Any) -> bytes:
    return model(
        nodes or [node("Tanh", ["x"], ["u"])], constants or {}, given.pop("inputs", {"x": ("n", 2)}), ["u"], **given
    )


SPARSE = message([(1, 8), (7, message([(15, b"")])), (8, message([(2, 17)]))])
ELSEWHERE = message(
    [(1, 8), (7, message([(5, message([(1, 2), (2, 1), (8, "w"), (14, 1)]))])), (8, message([(2, 17)]))]
)
HUGE = message(
    [
        (1, 8),
        (7, message([(5, message([(1, 1 << 40), (1, 1 << 40), (2, 1), (8, "w"), (9, b"1234")]))])),
        (8, message([(2, 17)])),
    ]
)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "it is no ONNX file"),
        (b"PK\x03\x04 a zip file", "it is no ONNX file, or damaged: byte "),
        (dense()[:-7], "damaged: byte "),
        (changed(version=5), "version 5, and those of versions 11 to 30"),
        (changed(node("Tanh", ["x"], ["u"], domain="com.acme")), r"Tanh \(number 0\) is one of `com.acme`"),
        (changed(node("Softmax", ["x"], ["u"])), "is an operator that is not supported; supported are"),
        (changed(node("Loop", ["x"], ["u"])), "Loop .* is not supported"),
        (changed(node("Tanh", ["v"], ["u"]), node("Tanh", ["u"], ["v"])), "reads `v` before .* or in a cycle"),
        (changed(node("Tanh", ["x"], ["x"])), "`x` is computed twice"),
        (changed(node("Tanh", ["x"], ["v"])), "its output `u` is not computed"),
        (changed(inputs={"x": None}), "the shape of its input `x` is unknown"),
        (changed(inputs={"x": ("n", "k")}), "input `x` has `k` as its dimension 1, which is a number"),
        (changed(inputs={"x": (8, 2)}), "input `x` has `8` as its rows, which is 1 or a name"),
        (changed(inputs={"x": (2,)}), "input `x` has 1 dimensions"),
        (changed(inputs={"x": ("n", 2), "h": (1, "n", 4)}), "1 outputs are not an action and the next of 1 states"),
        (changed(node("Tanh", ["x"], ["u"], alpha=1.0)), "has the attribute `alpha`, which is not supported"),
        (changed(node("Gemm", ["x", "x"], ["u"])), "has an input 1 that is no constant"),
        (changed(node("MatMul", ["x", "w"], ["u"]), constants={"w": numbers(3, 2)}), r"multiplies \(rows, 2\) by"),
        (changed(node("Add", ["x", "w"], ["u"]), constants={"w": numbers(3)}), r"combines .* and \(3\)"),
        (changed(node("Transpose", ["x"], ["t"]), node("Add", ["x", "t"], ["u"])), "combines"),
        (changed(constants={"w": np.array([[np.nan], [1]], "<f4")}), "`w` has an element that is not finite"),
        (changed(node("Add", ["x", "w"], ["u"]), constants={"w": np.array([1, 2], "<i8")}), "computes with integers"),
        (changed(node("Add", ["a", "b"], ["u"]), constants={"a": numbers(4000, 1), "b": numbers(4000)}), "more than"),
        (changed(node("GRU", ["x", "w", "w"], ["u"]), constants={"w": numbers(1, 3, 2)}), r"GRU .* reads \(rows, 2\)"),
        (SPARSE, "sparse constants are not supported"),
        (ELSEWHERE, "the constant `w` is in another file"),
        (HUGE, r"the constant `w` has 4 bytes, not the \d+ bytes of its shape"),
    ],
)  # fmt: skip
def test_damaged_and_unsupported_files_are_refused_with_a_message(content: bytes, said: str) -> None:
    with pytest.raises(OnnxError, match=said):
        network(content)


def test_operators_that_would_multiply_for_ever_are_refused() -> None:
    weights = np.ones((500, 500), "<f4")
    nodes = [node("MatMul", [f"v{number}", "w"], [f"v{number + 1}"]) for number in range(200)]
    content = model(nodes, {"w": weights}, {"v0": ("n", 500)}, ["v200"])
    with pytest.raises(OnnxError, match="the network takes more than"):
        network(content)


VALID = (dense(), recurrent())


@given(
    content=st.sampled_from(VALID),
    flips=st.lists(st.tuples(st.integers(0, 2**16), st.integers(1, 255)), max_size=4),
    length=st.integers(0, 2**16),
)
@example(content=VALID[0], flips=[(0, 0)], length=2**16)
@settings(max_examples=400, deadline=None)
def test_flipped_and_missing_bytes_give_a_message_or_numbers(
    content: bytes, flips: list[tuple[int, int]], length: int
) -> None:
    damaged = bytearray(content)
    for place, mask in flips:
        damaged[place % len(damaged)] ^= mask
    if length % 3 == 0:
        damaged = damaged[: length % len(damaged)]
    try:
        found = network(bytes(damaged))
    except OnnxError:
        return
    actions, _ = found(np.ones((2, found.observed)), found.initial_states(2))
    assert actions.shape == (2, found.actions)


@pytest.mark.parametrize("name", ["policy.pt", "policy.zip", "policy.pkl"])
def test_formats_that_may_contain_code_are_not_opened(tmp_path: Path, name: str) -> None:
    with pytest.raises(PolicyError, match=r"may contain code, .* is not opened: export the network as ONNX"):
        Policy(tmp_path / name)


def test_files_that_are_missing_or_too_large_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="cannot be read: No such file"):
        Policy(tmp_path / "no.onnx")
    large = tmp_path / "large.onnx"
    with large.open("wb") as file:
        file.truncate(LARGEST + 1)
    with pytest.raises(PolicyError, match="is larger than"):
        Policy(large)


def test_a_written_policy_normalises_and_stays_within_its_bounds(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    layers = [
        (random.standard_normal((3, 8)), random.standard_normal(8)),
        (random.standard_normal((8, 2)), np.zeros(2)),
    ]
    mean, deviation = np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.5, 2.0])
    path = write_policy(tmp_path / "p.onnx", layers, mean=mean, deviation=deviation, low=[0.0, -2.0], high=[1.5, 2.0])
    policy = Policy(path)
    x = random.standard_normal((50, 3))
    output = np.tanh((x - mean) / deviation @ layers[0][0] + layers[0][1]) @ layers[1][0]
    expected = np.array([0.75, 0.0]) + np.clip(output, -1.0, 1.0) * np.array([0.75, 2.0])
    np.testing.assert_allclose(policy(x), expected, rtol=1e-12)
    assert policy(x[0]).tolist() == policy(x)[0].tolist()


def test_a_recurrent_policy_is_a_function_of_its_past_until_it_is_reset(tmp_path: Path) -> None:
    path = tmp_path / "p.onnx"
    path.write_bytes(recurrent())
    policy, x = Policy(path), np.ones(4)
    first, second = policy(x), policy(x)
    assert first.tolist() != second.tolist()
    with pytest.raises(ValueError, match="2 agents in an episode of 1: call `reset`"):
        policy(np.ones((2, 4)))
    policy.reset()
    assert policy(x).tolist() == first.tolist()
    with pytest.raises(ValueError, match=r"the observations have the shape \(3,\), not \(4,\)"):
        policy(np.ones(3))


def test_layers_that_do_not_fit_together_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"layer 1 has weights \(9, 2\) and a bias \(2,\) for 8 values"):
        write_policy(tmp_path / "p.onnx", [(np.ones((3, 8)), np.ones(8)), (np.ones((9, 2)), np.ones(2))])


def test_constants_may_be_listed_instead_of_raw() -> None:
    listed = message([(1, 2), (1, 1), (2, 1), (8, "w"), (4, np.array([2.0, 3.0], "<f4").tobytes())])
    plain = changed(node("MatMul", ["x", "w"], ["u"]), constants={"w": np.array([[2.0], [3.0]], "<f4")})
    raw = tensor(np.array([[2.0], [3.0]], "<f4"), "w")
    assert len(listed) == len(raw)
    actions, _ = network(plain.replace(raw, listed))(np.array([[1.0, 10.0]]))
    assert actions.tolist() == [[32.0]]
