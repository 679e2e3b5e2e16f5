"""Networks and exchanges put together from classes, for tests."""

import numpy as np
from simulating import STEP, Team, simulation

from symaware_cli.core import Message, MessageBatch
from symaware_cli.network.channel.channel_parameters import ChannelParameters
from symaware_cli.network.exchange import MemoryExchange
from symaware_cli.network.network import Network, TopologyPhase


def world(count, positions=None, seed=7, obstacles=None):
    """A world with `robot.0`, `robot.1`, ... in it, initialised."""
    state = [list(each) for each in positions] if positions is not None else None
    return simulation({"robot": Team(count=count, state=state)}, seed=seed, obstacles=obstacles).environment


def laid(topology, environment, seed=7, **parameters):
    """A topology of a class, initialised."""
    made = topology(topology.Parameters(**parameters))
    made.initialise(environment, seed)
    return made


def pairs(links):
    """The links as pairs of indices."""
    return list(zip(links.senders.tolist(), links.receivers.tolist(), strict=True))


class Post:
    """An exchange that writes down what it tells."""

    def __init__(self, topology=None, channel=None, ids=None, seed=7, overrides=(), kinds=(), time_step=STEP):
        ids = topology.roster.ids if topology is not None else ids
        self.traffic = []
        self.exchange = MemoryExchange(
            ids,
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
            self.exchange.inboxes.open(kind, ids, [kind], columns=True)
        self.exchange.deliver(0)

    def stage(self, stage):
        """What was told of messages at a stage: each with why it was dropped."""
        ids = self.exchange._ids
        return [told for each in self.traffic if each.stage == stage for told in each.messages(ids)]

    def count(self, stage):
        """How many messages were told of at a stage."""
        return sum(len(each.delivery) for each in self.traffic if each.stage == stage)

    def reasons(self):
        """Why messages were dropped, each with how often."""
        dropped = [each for each in self.traffic if each.stage == "dropped"]
        names = [each.reasons[number] for each in dropped for number in each.reason.tolist()]
        return {name: names.count(name) for name in sorted(set(names))}

    def send(self, sender, receiver, **payload):
        """Send a single message, which sets out at once."""
        self.exchange.send(Message(sender, receiver, payload))
        self.exchange.flush()

    def post(self, senders=None, size=1, kind="news", receivers=None):
        """Send a batch of some agents, or of all; what they say are numbers."""
        count = len(self.exchange._ids)
        senders = np.arange(count) if senders is None else np.array(senders)
        receivers = None if receivers is None else np.array(receivers)
        self.exchange.post(MessageBatch(senders, {"said": np.zeros((len(senders), size))}, kind, receivers))

    def until(self, end, start=STEP, step=STEP):
        """Let time pass."""
        for now in range(start, end + 1, step):
            self.exchange.deliver(now)
