"""Agents whose perception fails, among others whose perception goes on."""

from simulating import STEP, Team, simulation

from symaware_cli.components.communication.inbox import Inbox
from symaware_cli.components.communication.state import StateSender
from symaware_cli.components.perception import OmniscientPerception
from symaware_cli.runtime.faults import Blind, Components, Fault
from symaware_cli.runtime.run import run
from symaware_cli.runtime.terms import Terms


def known(components, **others):
    """Of whom the first of two agents is aware in each step, and where the second believes the first to be."""
    ready = simulation({"pair": Team({"see": OmniscientPerception, **components}, count=2), **others})
    group, slot, frames = ready.groups[0], ready.slots[0], []

    def look():
        near = group.others(100.0)
        frames.append((near.others[near.observers == 0].tolist(), near.positions[near.observers == 1][0, 0]))

    ready.events.subscribe("iterated", lambda event: look())
    group.control_input = [[1.0, 0.0]] * 2
    fault = Fault("fog", "fog", "run", Blind([Components(slot, [0])]), 5 * STEP, lasting=10 * STEP)
    summary = run(ready, 20, terms=Terms(faults=[fault]))
    assert summary.status == "finished", summary.failure
    return [frame[0] for frame in frames[:20]], [frame[1] for frame in frames[:20]]


def test_who_is_not_blinded_sees_where_the_others_are_now():
    aware, positions = known({})
    assert aware == [*[[1]] * 5, *[[]] * 10, *[[1]] * 5]
    assert positions == sorted(set(positions))


def test_who_is_blinded_still_knows_what_it_is_told():
    aware, _ = known({"hear": Inbox}, speaker=Team({"tell": StateSender}))
    assert aware[4:7] == [[1, 2], [2], [2]]
    assert aware[15] == [1, 2]
