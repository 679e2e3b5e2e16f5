"""Colours."""

import numpy as np

from symaware_cli.views.palette import (
    AGENTS,
    BACKGROUND,
    DISTINCT,
    RISK,
    SCENERY,
    agent_colours,
    body_colours,
    faded,
    hexadecimal,
    tinted,
)


def test_a_few_agents_have_colours_of_their_own() -> None:
    first, second = agent_colours([3, 2])
    assert len({tuple(colour) for colour in [*first.tolist(), *second.tolist()]}) == 5


def test_many_agents_have_that_of_their_group() -> None:
    first, second = agent_colours([DISTINCT, 1])
    assert {tuple(colour) for colour in first.tolist()} == {AGENTS[0]}
    assert second.tolist() == [list(AGENTS[1])]


def test_no_agent_is_red_for_that_is_the_colour_of_risk() -> None:
    assert all(np.linalg.norm(np.subtract(colour, RISK)) > 80 for colour in AGENTS)


def test_risk_tints_from_the_own_colour_to_red() -> None:
    own = np.array([[0, 100, 200]] * 5, np.uint8)
    risks = [0.0, 1.0, 7.0, np.inf, np.nan]
    assert tinted(own, risks).tolist() == [[0, 100, 200], *[list(RISK)] * 3, [0, 100, 200]]


def test_fading_colours_end_in_the_background() -> None:
    assert faded(np.array([200, 100, 50], np.uint8), 1.0).tolist() == list(BACKGROUND)
    assert faded(np.array([200, 100, 50], np.uint8), 0.0).tolist() == [200, 100, 50]


def test_a_colour_is_written_as_the_web_does() -> None:
    assert hexadecimal((1, 16, 255)) == "#0110ff"


def test_bodies_of_a_kind_look_alike_and_others_do_not() -> None:
    colours = body_colours(["ball1", "ball2", "ball10", "cue", "door_1", "door_2", "7"], SCENERY)
    assert [colours[name] for name in ("ball1", "ball2", "ball10")] == [SCENERY] * 3
    assert colours["door_1"] == colours["door_2"]
    assert len({SCENERY, colours["cue"], colours["door_1"], colours["7"], *AGENTS}) == 4 + len(AGENTS)
    assert len(set(body_colours([f"{letter}x" for letter in "abcdefghijklmnop"], SCENERY).values())) > 8
