"""What agents tell each other, and what they make of it."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, present
from talking import Watch, made, team

from symaware_cli import Agent, TimeSeries
from symaware_cli.engine.components.communication.inbox import Inbox
from symaware_cli.engine.components.communication.state import Broadcast, StateSender
from symaware_cli.engine.components.perception import SelfPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.network.topology.fixed import Complete


class TestStates:
    def test_a_message_about_another_has_its_position_and_velocity(self) -> None:
        # Robots stand 1 m apart and move at 2 m/s; what is told arrives with the next step.
        watch = Watch({"robot": team(control=lambda agent: [2.0, 0.0], tell=StateSender, hear=Inbox)})
        awareness = watch.groups["robot"].awareness
        watch.run(5, lambda: (watch.simulation.environment.snapshot().positions, awareness.tracks))
        truth, tracks = watch.frames[4]
        assert tracks.others.tolist() == [1, 0]
        # The velocity that was told is that of the step before, as everybody goes straight on it is still right.
        assert np.allclose(tracks.positions, truth[[1, 0]])
        assert np.allclose(tracks.velocities, [[2.0, 0.0]] * 2)
        assert np.allclose(tracks.ages, STEP / 1e9)
        assert watch.frames[0][1] is None

    def test_uncertainty_grows_with_the_age_of_a_message(self) -> None:
        quiet = {"threshold": 100.0, "silence": None}
        noise = {"position_noise": 0.1, "velocity_noise": 0.2, "acceleration_noise": 0.5, "memory": 100.0}
        watch = Watch({"robot": team(tell=made(StateSender, **quiet), hear=made(Inbox, **noise))})
        awareness = watch.groups["robot"].awareness
        watch.run(60, lambda: awareness.tracks)
        age = 40 * STEP / 1e9
        tracks = watch.frames[40]
        assert np.allclose(tracks.ages, age)
        spread = 0.1**2 + 0.2**2 * age**2 + 0.5**2 * age**3 / 3
        between = 0.2**2 * age + 0.5**2 * age**2 / 2
        moving = 0.2**2 + 0.5**2 * age
        expected = np.kron([[spread, between], [between, moving]], np.eye(2))
        assert np.allclose(tracks.covariances, expected)

    def test_an_agent_that_sends_no_more_is_forgotten(self) -> None:
        watch = Watch(
            {"robot": team(tell=made(StateSender, threshold=100.0), hear=made(Inbox, memory=0.5))},
        )
        awareness = watch.groups["robot"].awareness
        watch.run(15, lambda: 0 if awareness.tracks is None else len(awareness.tracks))
        # Told at 0 s, heard at 0.05 s, remembered up to 0.5 s.
        assert watch.frames[:13] == [0, *[2] * 10, 0, 0]

    def test_an_agent_speaks_up_when_others_would_be_wrong(self) -> None:
        # One goes straight on, one turns after 10 steps.
        def control(agent: Agent) -> list[float]:
            turned = agent.row == 1 and agent.surroundings.clock.now >= 10 * STEP
            return [0.0, 1.0] if turned else [1.0, 0.0]

        watch = Watch({"robot": team(control=control, tell=made(StateSender, threshold=0.2), hear=Inbox)})
        sent = []
        watch.simulation.events.subscribe("sent", lambda event: sent.append((event.time // STEP, event.subject.sender)))
        watch.run(30)
        # At the first turn nobody moves yet; a step of 0.05 m is noticed after 4 of them, and then they go straight on.
        assert sent[:2] == [(0, "robot.0"), (0, "robot.1")]
        later = [each for each in sent if each[0] > 6]
        assert [sender for _, sender in later] == ["robot.1"]
        assert 12 <= later[0][0] <= 15

    def test_knowledge_in_a_message_becomes_knowledge_of_the_sender(self) -> None:
        knowledge = [{"goal": [1.0, 2.0]}, {"goal": [3.0, 4.0]}]
        watch = Watch(
            {"robot": team(knowledge=knowledge, tell=made(StateSender, knowledge=("goal",)), hear=Inbox)}
        ).run(3)
        agent = watch.groups["robot"].agents[0]
        assert agent.knowledge_database["robot.1"]["goal"].tolist() == [3.0, 4.0]

    def test_detections_take_precedence_over_earlier_messages(self) -> None:
        see = made(RangePerception, range=1.5)
        watch = Watch({"robot": Team({"sense": see, "tell": StateSender, "hear": Inbox}, count=3)}).run(4)
        tracks = watch.groups["robot"].awareness.tracks
        # 0 and 2 are 2 m apart: they are told of each other.
        assert [
            tuple(each)
            for each in zip(present(tracks).observers.tolist(), present(tracks).others.tolist(), strict=True)
        ] == [*((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))]
        assert tracks is not None
        assert tracks.ages.tolist() == [0.0, 0.05, 0.0, 0.0, 0.05, 0.0]

    def test_of_late_messages_the_one_that_was_sent_last_counts(self) -> None:
        watch = Watch(
            {"robot": team(control=lambda agent: [1.0, 0.0], tell=StateSender, hear=Inbox)},
            Complete,
            {"delay": {"uniform": [0.0, 1.0]}},
        )
        inbox: Any = watch.simulation.entries[2].components[0]
        watch.run(80, lambda: inbox.kept.sent.tolist())
        sent = np.array([frame for frame in watch.frames if len(frame) == 2])
        assert (np.diff(sent, axis=0) >= 0).all()

    @pytest.mark.parametrize(("policy", "most"), [("latest", 1), ("window", 5), ("all", 40)])
    def test_the_inbox_keeps_what_its_policy_says(self, policy: str, most: int) -> None:
        tell = made(StateSender)
        hear = made(Inbox, policy=policy, window=0.25, position_noise=0.1, memory=100.0)
        watch = Watch({"robot": team(tell=tell, hear=hear)}).run(40)
        inbox: Any = watch.simulation.entries[2].components[0]
        assert len(inbox.kept.keys) == 2 * (most - (policy == "all"))

    def test_messages_that_are_kept_are_averaged_by_their_certainty(self) -> None:
        class Blurred(SelfPerception):
            def _update(self, value: NDArray[np.float64]) -> None:
                super()._update(value)
                self._group.awareness.state = self._group.awareness.state + self.random.standard_normal(2)

        def error(policy: str) -> float:
            hear = made(
                Inbox, policy=policy, window=1.0, position_noise=1.0, velocity_noise=0.0, acceleration_noise=0.0
            )
            watch = Watch({"robot": Team({"sense": Blurred, "tell": StateSender, "hear": hear}, count=60)}).run(25)
            tracks = watch.groups["robot"].awareness.tracks
            assert tracks is not None
            return float((tracks.positions - watch.simulation.environment.snapshot().positions[tracks.others]).std())

        # The mean of 20 messages is sqrt(20) times as exact as the latest. That of 120 errors is known to 6.5 %:
        # 1 / sqrt(2 * 120).
        assert error("latest") == pytest.approx(1.0, rel=0.2)
        assert error("window") == pytest.approx(1.0 / np.sqrt(20), rel=0.3)

    def test_unsendable_knowledge_is_reported_before_the_run(self) -> None:
        group = team(knowledge=[{"name": "a"}, {"name": "b"}]).group("robot")
        for parameters, problem in (
            ({"knowledge": ("goal",)}, "do not know `goal`"),
            ({"knowledge": ("name",)}, "must be numbers"),
            ({"silence": 1.0}, "which is missing"),
        ):
            with pytest.raises(ValueError, match=problem):
                StateSender(StateSender.Parameters(**parameters)).check(group)


class TestBroadcasts:
    def test_awareness_and_knowledge_of_any_kind_reach_all(self) -> None:
        def mean(agent: Agent) -> list[float]:
            agent.self_awareness.intent = TimeSeries({1.0: [agent.row, 0.0]})
            return [0.0, 0.0]

        knowledge = [{"name": "anna"}, {"name": "bert"}, {"name": "carl"}]
        tell = made(Broadcast, knowledge=("name",))
        watch = Watch({"robot": team(3, mean, knowledge, tell=tell, hear=Inbox)}).run(4)
        agent = watch.groups["robot"].agents[0]
        assert agent.knowledge_database["robot.2"]["name"] == "carl"
        vector = agent.awareness_database["robot.2"]
        assert vector.state.tolist() == [2.0, 0.0, 0.0, 0.0]
        assert vector.intent[1.0].tolist() == [2.0, 0.0]
        # At the last turn, by when it had become less certain.
        assert vector.uncertainty.times.tolist() == [3 * STEP]
