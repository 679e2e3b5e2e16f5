"""Messages as arrows, and who was told what goes around."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from numpy.typing import ArrayLike, NDArray
from rerun_files import STEP, Recording, Script, group, saved

from symaware_cli import open_log
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.views.palette import LOSS, MESSAGE, faded
from symaware_cli.views.replay_session import replay_session
from symaware_cli.views.rerun.output import RerunOutput
from symaware_cli.views.scene.arrows import arrows, broken
from symaware_cli.views.scene.messages import Messages

DISC = {"circle": {"radius": 0.5}}
DROPPED = v1.Message.DROPPED
#: How many instants an arrow of 0.3 s is to be seen at.
SEEN = 6


@pytest.fixture
def script(tmp_path: Path) -> Script:
    """One who stands, and one who drives away from it along x, 0.1 m a step, for 20 steps."""
    script = Script(tmp_path / "a.mcap", {"mast": group("mast", shape=DISC), "car": group("car", shape=DISC)})
    script.say("/world/mast/state", STEP, wire.encode_rows([[0, 0]]), "Rows")
    for step in range(1, 21):
        script.say("/world/car/state", step * STEP, wire.encode_rows([[5 + 0.1 * step, 0]]), "Rows")
    return script


def shown(recording: Recording) -> list[tuple[int, list[NDArray[np.float64]], list[int]]]:
    """What is drawn of messages: time in steps, lines and their colours."""
    lines = dict(recording.rows["/world/messages", "LineStrips3D:strips"])
    colours = dict(recording.rows["/world/messages", "LineStrips3D:colors"])
    return [
        (time // STEP, [np.array(line) for line in lines[time] or []], [packed >> 8 for packed in colours[time] or []])
        for time in lines
        if time is not None
    ]


def packed(colour: ArrayLike) -> int:
    return int.from_bytes(bytes(np.asarray(colour).tolist()), "big")


def tip(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where an arrow points to: of its last strokes, which have this point in common."""
    result: NDArray[np.float64] = line[-2]
    return result


def test_an_arrow_goes_with_those_at_its_ends_fades_and_is_gone(script: Script, tmp_path: Path) -> None:
    script.message(4 * STEP, "mast", "car", sent_time=STEP)
    found = shown(saved(script.finish(), tmp_path))
    assert [step for step, _, _ in found] == list(range(4, 4 + SEEN + 1))
    for number, (step, lines, colours) in enumerate(found[:-1]):
        (line,) = lines
        # From rim to rim, and then a little.
        assert line[0][0] == pytest.approx(0.5, abs=0.2)
        assert tip(line)[0] == pytest.approx(5 + 0.1 * step - 0.5, abs=0.2)
        assert colours == [packed(faded(np.array(MESSAGE), 0.75 * number / SEEN))]
    assert found[-1][1] == []


def test_the_head_of_an_arrow_is_at_the_receiver(script: Script, tmp_path: Path) -> None:
    script.message(4 * STEP, "car", "mast", sent_time=STEP)
    _, (line,), _ = shown(saved(script.finish(), tmp_path))[0]
    assert tip(line)[0] == pytest.approx(0.5, abs=0.2)
    assert (line[[-3, -1], 0] > tip(line)[0]).all()
    # Above the bodies, which would hide it.
    assert (line[:, 2] > 0.5).all()


def test_a_lost_message_is_red_and_its_arrow_ends_on_the_way(script: Script, tmp_path: Path) -> None:
    script.message(4 * STEP, "mast", "car", stage=DROPPED, sent_time=STEP)
    _, (line,), colours = shown(saved(script.finish(), tmp_path))[0]
    assert colours == [packed(LOSS)]
    assert 1.0 < line[:, 0].max() < 0.6 * 5.4


def test_of_a_link_the_latest_message_is_shown_and_both_ways_are_apart(script: Script, tmp_path: Path) -> None:
    script.message(4 * STEP, "mast", "car", sent_time=STEP)
    script.message(4 * STEP, "car", "mast", sent_time=STEP)
    script.message(6 * STEP, "mast", "car", stage=DROPPED, sent_time=5 * STEP)
    found = {step: (lines, colours) for step, lines, colours in shown(saved(script.finish(), tmp_path))}
    (there, back), _ = found[4]
    assert there[:, 1].min() < -0.5
    assert back[:, 1].max() > 0.5
    assert packed(LOSS) in found[6][1]
    assert [len(lines) for lines, _ in found.values()] == [2] * 6 + [1] * 2 + [0]


def test_agents_without_a_position_send_nothing(script: Script, tmp_path: Path) -> None:
    script.message(0, "mast", "car", sent_time=0)
    assert all(step > 0 for step, lines, _ in shown(saved(script.finish(), tmp_path)) if lines)


def test_where_a_log_is_cut_into_chunks_does_not_show(script: Script, tmp_path: Path) -> None:
    for step, sender, receiver in ((2, "mast", "car"), (4, "car", "mast"), (5, "mast", "car"), (11, "mast", "car")):
        script.message(step * STEP + 1000, sender, receiver, sent_time=0)
    log = script.finish()
    whole = replay_session(log)
    drawn = []
    for size in (1, 1 << 20):
        recording = rr.RecordingStream("test")
        recording.save(tmp_path / "cut.rrd")
        messages, output = Messages(whole.run_view, whole.detail), RerunOutput(recording)
        messages._width = 10.0  # which is that of the first chunk
        for chunk in whole._replay(recording).chunk_reader().chunks(open_log(log.path).messages(), size):
            for mark in messages.marks(chunk):
                output.show(mark)
        recording.flush()
        recording.disconnect()
        drawn.append(shown(Recording(tmp_path / "cut.rrd")))
    # What is drawn of a moment twice counts as it was drawn last.
    one, other = drawn
    assert [step for step, _, _ in one] == [step for step, _, _ in other]
    for (_, lines, colours), (_, other_lines, other_colours) in zip(one, other, strict=True):
        assert colours == other_colours
        np.testing.assert_allclose(lines, other_lines, atol=1e-6)


@pytest.mark.parametrize("draw", [arrows, broken])
def test_arrows_may_point_anywhere(draw: Callable[..., NDArray[np.float64]]) -> None:
    targets = np.array([[3.0, 0, 0], [0, -2, 0], [0, 0, 4], [0, 0, -4], [1, 2, -3]])
    count = len(targets)
    lines = draw(np.zeros((count, 3)), targets, np.full(count, 0.1), np.full(count, 0.9), np.full(count, 0.2))
    assert np.isfinite(lines).all()
    np.testing.assert_allclose(
        np.linalg.norm(lines[:, 0] - 0.1 * targets, axis=1) / np.linalg.norm(targets, axis=1), 0.0576
    )


def test_senders_and_receivers_have_a_dot_from_then_on(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1", "a.2"), "car": group("car")})
    for step in range(4):
        script.say("/world/a/state", step * STEP, wire.encode_rows([[step, 0], [step, 1], [step, 2]]), "Rows")
    script.say("/world/car/state", 0, wire.encode_rows([[9, 9]]), "Rows")
    told = v1.Event(name="informed", source="agents.a.1.tell", data=json.dumps({"other": "car"}))
    script.say("/events", 2 * STEP, told.SerializeToString(), "Event")
    script.event(3 * STEP, "heard", "agents.a.0.tell")
    recording = saved(script.finish(), tmp_path)
    places = dict(recording.rows["/world/agents/a/informed", "Points3D:positions"])
    marked = {time // STEP: np.array(places[time])[:, 0] for time in places if time is not None}
    nobody = [np.nan] * 3
    np.testing.assert_array_equal(
        [marked[step] for step in range(4)], [nobody, nobody, [np.nan, 2, np.nan], [np.nan, 3, np.nan]]
    )
    car = dict(recording.rows["/world/agents/car/informed", "Points3D:positions"])
    assert car[2 * STEP] == [[9, 9, 0]]
