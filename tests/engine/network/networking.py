"""Networks and exchanges put together from classes, for tests."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from simulating import STEP, Team, present, simulation

from symaware_cli import Environment, Links, Obstacle, Topology
from symaware_cli.core import Message, MessageBatch
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.exchange import MessageExchange
from symaware_cli.engine.network.network import ChannelOverride, Network, TopologyPhase
from symaware_cli.engine.network.traffic import Traffic

Array = NDArray[np.float64]
Laid = TypeVar("Laid", bound=Topology)


def world(
    count: int,
    positions: Sequence[Sequence[float]] | Array | None = None,
    seed: int = 7,
    obstacles: Mapping[str, Obstacle] | None = None,
) -> Environment:
    """A world with `robot.0`, `robot.1`, ... in it, initialised."""
    state = [list(each) for each in positions] if positions is not None else None
    return simulation({"robot": Team(count=count, state=state)}, seed=seed, obstacles=obstacles).environment


def laid(topology: type[Laid], environment: Environment, seed: int = 7, **parameters: Any) -> Laid:
    """A topology of a class, initialised."""
    made = topology(topology.Parameters(**parameters))
    made.initialise(environment, seed)
    return made


def pairs(links: Links) -> list[tuple[int, int]]:
    """The links as pairs of indices."""
    return list(zip(links.senders.tolist(), links.receivers.tolist(), strict=True))


class Post:
    """An exchange that writes down what it tells."""

    def __init__(
        self,
        topology: Topology | None = None,
        channel: Mapping[str, Any] | None = None,
        ids: Sequence[str] | None = None,
        seed: int = 7,
        overrides: Sequence[ChannelOverride] = (),
        kinds: Sequence[str] = (),
        time_step: int = STEP,
    ) -> None:
        everybody = topology.roster.ids if topology is not None else present(ids)
        self.traffic: list[Traffic] = []
        self.exchange = MessageExchange(
            everybody,
            on_traffic=self.traffic.append,
            seed=seed,
            time_step=time_step,
        )
        if topology is not None:
            self.exchange.network = Network(
                topology.roster,
                [TopologyPhase(0, topology)],
                channel=ChannelParameters.model_validate(channel or {}),
                overrides=overrides,
            )
        for kind in kinds:
            self.exchange.inboxes.open(kind, everybody, [kind], columns=True)
        self.exchange.deliver(0)

    def stage(self, stage: str) -> list[tuple[Message, str]]:
        """What was told of messages at a stage: each with why it was dropped."""
        ids = self.exchange._ids
        return [told for each in self.traffic if each.stage == stage for told in each.messages(ids)]

    def count(self, stage: str) -> int:
        """How many messages were told of at a stage."""
        return sum(len(each.delivery) for each in self.traffic if each.stage == stage)

    def reasons(self) -> dict[str, int]:
        """Why messages were dropped, each with how often."""
        dropped = [each for each in self.traffic if each.stage == "dropped"]
        names = [each.reasons[number] for each in dropped for number in present(each.reason).tolist()]
        return {name: names.count(name) for name in sorted(set(names))}

    def send(self, sender: str, receiver: str, **payload: Any) -> None:
        """Send a single message, which sets out at once."""
        self.exchange.send(Message(sender, receiver, payload))
        self.exchange.flush()

    def post(
        self,
        senders: Sequence[int] | None = None,
        size: int = 1,
        kind: str = "news",
        receivers: Sequence[int] | None = None,
    ) -> None:
        """Send a batch of some agents, or of all; what they say are numbers."""
        count = len(self.exchange._ids)
        told = np.arange(count) if senders is None else np.array(senders)
        aim = None if receivers is None else np.array(receivers)
        self.exchange.post(MessageBatch(told, {"said": np.zeros((len(told), size))}, kind, aim))

    def until(self, end: int, start: int = STEP, step: int = STEP) -> None:
        """Let time pass."""
        for now in range(start, end + 1, step):
            self.exchange.deliver(now)
