"""Ranges of values are bounded, and never confused with intervals."""

from pathlib import Path

import pytest
from sweeping import symaware, tiny

from symaware_cli.world import expanded, is_range


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0..3", [0, 1, 2, 3]),
        ("-1..1", [-1, 0, 1]),
        ("3..1 by -1", [3, 2, 1]),
        ("0..1 by 0.25", [0.0, 0.25, 0.5, 0.75, 1.0]),
        ("0.5..0.7 by .1", [0.5, 0.6, 0.7]),
        ("1e2..3e2 by 1e2", [100.0, 200.0, 300.0]),
    ],
)
def test_a_range_includes_both_ends(text: str, values: list[float]) -> None:
    assert is_range(text)
    assert expanded(text) == values


@pytest.mark.parametrize("text", ["0.5..1.4", "0..1.5", "-1.0..1", "1e2..3e2", ".5..2"])
def test_a_range_with_non_integer_ends_needs_a_step(text: str) -> None:
    with pytest.raises(ValueError, match="has no step") as caught:
        expanded(text)
    first, _, last = text.partition("..")
    assert f"`{text} by STEP`" in str(caught.value)
    assert f"{{uniform: [{first}, {last}]}}" in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "0..1e9999999 by 1",
        "0..1 by 1e-9999999",
        "-1e31..1e31 by 1e30",
        "0..1 by 0",
        "1..0",
        "0..1 by 1e-9",
        f"{'9' * 50}..{'9' * 51}",
    ],
)
def test_a_range_is_bounded(text: str) -> None:
    with pytest.raises(ValueError, match=r"range"):
        expanded(text)


def test_long_text_is_quickly_rejected_as_a_range() -> None:
    for text in ("1" * 1_000_000, "1" * 1_000_000 + "..2", " " * 1_000_000 + "..", "1.." * 500_000):
        assert not is_range(text)
        assert expanded(text) == text


@pytest.mark.parametrize("form", ["{}", "{{choice: {}}}"])
@pytest.mark.parametrize("verb", ["plan", "falsify"])
def test_every_verb_rejects_an_interval_without_a_step(verb: str, form: str, tmp_path: Path) -> None:
    over = f"agents.robot.components.steer.with.speed={form.format('0.5..1.4')}"
    options = () if verb == "plan" else ("--specification", "near", "-o", tmp_path / "out")
    said = symaware(verb, tiny(tmp_path), "--over", over, *options, status=2)
    assert "has no step" in said
    assert "{uniform: [0.5, 1.4]}" in said
    assert not (tmp_path / "out").exists()


def test_branches_reject_an_interval_without_a_step(tmp_path: Path) -> None:
    symaware("run", tiny(tmp_path), "--quiet", "-o", tmp_path / "run.mcap", "--set", "specifications={}")
    over = "agents.robot.components.steer.with.speed=0.5..1.4"
    said = symaware("branch", tmp_path / "run.mcap", "--at", "0.5", "--over", over, status=2)
    assert "has no step" in said
