"""Control of agents by nodes of ROS 2.

Reasons: docs/decisions/0101-inputs-from-outside.md
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from symaware_cli import AgentGroup, Event, GroupComponent, Level, Parameters, ScenarioView, StateError
from symaware_cli.bags.ros_names import topic_names
from symaware_cli.world import Scan
from symaware_ros import publications
from symaware_ros.commands import STAMPED, TWIST, CommandError, elements, stamp, twist
from symaware_ros.rosbridge import Published, Rosbridge, is_loopback

#: The greatest number of received and unused commands for one agent; a node that sends several for each step exceeds
#: it.
_MOST_WAITING = 100
#: Parts of a topic, with placeholders in braces for agents and sensors
#: (https://design.ros2.org/articles/topic_and_service_names.html).
_PART = r"(?:[A-Za-z_]|\{agent\}|\{sensor\})(?:\w|\{agent\}|\{sensor\})*"
_TOPIC = re.compile(rf"/{_PART}(?:/{_PART})*", re.ASCII)
_FRAME = re.compile(rf"{_PART}(?:/{_PART})*", re.ASCII)


def _is_topic(text: str) -> str:
    if not _TOPIC.fullmatch(text):
        raise ValueError("a topic is like /{agent}/odom: letters, digits and underscores, with {agent} and {sensor}")
    return text


def _is_frame(text: str) -> str:
    if not _FRAME.fullmatch(text):
        raise ValueError(
            "a frame is like {agent}/base_link: letters, digits and underscores, with {agent} and {sensor}"
        )
    return text


Topic = Annotated[str, AfterValidator(_is_topic)]
Frame = Annotated[str, AfterValidator(_is_frame)]


class Topics(Parameters):
    """The topics; `{agent}` stands for the id of an agent, with an underscore for the full stop."""

    command: Topic = Field("/{agent}/cmd_vel", description="Topic of commands.")
    odometry: Topic | None = Field("/{agent}/odom", description="Topic of odometry; none if null.")
    scan: Topic | None = Field("/{agent}/{sensor}", description="Topic of the scans of lidars; none if null.")
    transforms: Topic | None = Field("/tf", description="Topic of transforms; none if null.")
    clock: Topic | None = Field("/clock", description="Topic of the simulated time; none if null.")


class Frames(Parameters):
    """The names of frames."""

    world: Frame = Field("world", description="Frame that positions refer to.")
    body: Frame = Field("{agent}", description="The body of an agent.")
    sensor: Frame = Field("{agent}/{sensor}", description="A sensor on it.")


class RosControl(GroupComponent):
    """Lets nodes of ROS 2 control the agents of its group, over a rosbridge.

    At each turn the component publishes the clock, and the transforms, scans and odometry of each agent from its
    beliefs and measurements. Then it takes a command for each agent: a Twist, whose elements are the control input.

    In lock-step the run waits for the commands. The first command on a topic answers the first turn, the second command
    the second turn, and so on, no matter how late each arrives; with `stamped` a command answers the turn with the time
    of its stamp. So a node whose commands depend only on the published messages gives the same run each time. Without
    lock-step, the latest command is applied, and `run.pace` sets the speed of the run.

    Commands are recorded, so the run can be repeated and verified from its log without the nodes.
    """

    uncaptured: ClassVar = ("_bridge", "_waiting", "_names", "_elements")

    class Parameters(Parameters):
        """The rosbridge, and the topics and frames of its messages."""

        url: str = Field("ws://127.0.0.1:9090", description="URL of the rosbridge.")
        remote: bool = Field(False, description="Whether it may be on another machine.")
        lock_step: bool = Field(True, description="Whether the run waits for a command of each agent at each turn.")
        stamped: bool = Field(False, description="Whether commands are TwistStamped, with the time of the turn.")
        timeout: float = Field(
            5.0, gt=0, le=3600, description="Wall time without a command after which the run has failed [s]."
        )
        settle: float = Field(
            0.0,
            ge=0,
            le=600,
            description="Wall time after new topics were announced, so that nodes find them [s].",
        )
        topics: Topics = Field(default_factory=Topics, description="The topics.")
        frames: Frames = Field(default_factory=Frames, description="The frames.")

        @model_validator(mode="after")
        def _stays_here(self) -> RosControl.Parameters:
            try:
                is_here = is_loopback(self.url)
            except ValueError as error:
                raise ValueError(f"`url` is not that of a rosbridge: {error}") from None
            if not is_here and not self.remote:
                raise ValueError(
                    f"`{self.url}` is not on this machine: write `remote: true` if it is meant, since anybody who can "
                    "reach a rosbridge can command what it connects"
                )
            return self

    _bridge: Rosbridge | None = None

    def check(self, group: AgentGroup) -> None:
        """Check that a twist determines the control input of the model, and that topics differ."""
        names = [name for name, _ in group.model.control_input]
        found = elements(names)
        if found is None:
            raise ValueError(
                f"a twist is a velocity and a turn rate, and the control input of the model is {', '.join(names)}; use "
                "a model such as `unicycle`, `differential-drive` or `single-integrator`"
            )
        topics = self.parameters.topics
        for key in ("command", "odometry"):
            pattern = getattr(topics, key)
            if pattern is not None and len(group) > 1 and "{agent}" not in pattern:
                raise ValueError(f"`topics.{key}` needs {{agent}}, because the group has {len(group)} agents")
            if pattern is not None and "{sensor}" in pattern:
                raise ValueError(f"`topics.{key}` is not about a sensor: {pattern}")

    def check_scenario(self, view: ScenarioView) -> None:
        """Refuse to compute in a separate process, which has no access to the run's inputs from outside."""
        assert view.entry is not None
        use = view.document.agents[view.entry.group.name].components[view.entry.name]
        if use.run_in == "process":
            view.report("it waits for another program, and cannot compute in a process of its own", "run_in")

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without a connection, which the first turn opens."""
        super().initialise_component(group)
        self._close()
        self._elements = elements([name for name, _ in group.model.control_input])
        self._names = topic_names(group.ids)
        #: The received and unused commands, by topic.
        self._waiting: dict[str, deque[Any]] = {}
        #: The time of measurement of the last published scan of each sensor [ns].
        self._scanned: dict[str, int] = {}
        #: The last command of each agent.
        self._commands = np.zeros((len(group), 6))
        for name in ("finished", "failed", "interrupted"):
            self._surroundings.events.subscribe(name, self._on_end)

    def _compute(self) -> Mapping[str, Sequence[float]]:
        found: Mapping[str, Sequence[float]] = self.external_input(self._exchange)
        return found

    def _update(self, value: Mapping[str, Sequence[float]]) -> None:
        group = self._group
        commands = self._commands.copy()
        for id, command in value.items():
            commands[group.ids.index(id)] = command
        self._commands = commands
        self._scanned = {name: scan.time for name, scan in self._scans()}
        group.control_input = commands[:, self._elements]

    def _exchange(self) -> Mapping[str, Sequence[float]]:
        """Publish the beliefs and measurements of the agents, and return the commands of those that have one."""
        messages = list(self._messages())
        bridge = self._connected()
        if bridge.advertise(messages) and self.parameters.settle:
            time.sleep(self.parameters.settle)
        for each in messages:
            bridge.publish(each)
        agents = [self._group.ids[row] for row in self.acting]
        return self._answers(bridge, agents) if self.parameters.lock_step else self._latest(bridge, agents)

    def _connected(self) -> Rosbridge:
        if self._bridge is None:
            self._bridge = Rosbridge(self.parameters.url, self.parameters.timeout)
            for id in self._group.ids:
                self._bridge.subscribe(self._command_topic(id), STAMPED if self.parameters.stamped else TWIST)
        return self._bridge

    def _command_topic(self, id: str) -> str:
        return self._filled(self.parameters.topics.command, id)

    def _filled(self, pattern: str, id: str, sensor: str = "") -> str:
        return pattern.replace("{agent}", self._names[id]).replace("{sensor}", sensor)

    def _scans(self) -> Iterator[tuple[str, Scan]]:
        for name, reading in self._group.awareness.readings.items():
            if isinstance(reading, Scan):
                yield topic_names([name])[name], reading

    def _messages(self) -> Iterator[Published]:
        """Yield the messages of a turn: the clock, transforms, scans, and the odometry of each agent last."""
        topics, frames, group, now = self.parameters.topics, self.parameters.frames, self._group, self.now
        model, state = group.model, group.awareness.state
        rows = [row for row in self.acting if np.isfinite(state[row]).all()]
        positions = np.zeros((len(group), 3))
        found = model.positions(state)
        positions[:, : found.shape[1]] = found
        headings = np.zeros(len(group)) if model.heading is None else state[:, model.heading]
        scans = [(name, scan) for name, scan in self._scans() if publications.is_even(scan.angles)]
        bodies = {row: self._filled(frames.body, group.ids[row]) for row in rows}
        if topics.clock is not None:
            yield publications.clock(topics.clock, now)
        if topics.transforms is not None:
            poses = [(frames.world, bodies[row], positions[row].tolist(), float(headings[row])) for row in rows]
            mounted = [
                (bodies[row], self._filled(frames.sensor, group.ids[row], name), scan.mount, 0.0)
                for row in rows
                for name, scan in scans
            ]
            yield publications.transforms(topics.transforms, now, [*poses, *mounted])
        for name, scan in scans if topics.scan is not None else ():
            if self._scanned.get(name) == scan.time:
                continue
            for row in rows:
                topic = self._filled(topics.scan or "", group.ids[row], name)
                frame = self._filled(frames.sensor, group.ids[row], name)
                yield publications.scan(topic, scan.time, frame, scan.angles, scan.distances[row], scan.range)
        names = [name for name, _ in (*model.control_input, *model.state)]
        inputs = model.limit(group.control_input)
        for row in rows if topics.odometry is not None else ():
            topic = self._filled(topics.odometry or "", group.ids[row])
            values = (*inputs[row].tolist(), *state[row].tolist())
            motion = dict(zip(names, values, strict=True))
            parents = frames.world, bodies[row]
            at, heading = positions[row].tolist(), float(headings[row])
            yield publications.odometry(topic, now, parents, at, heading, motion)

    def _answers(self, bridge: Rosbridge, agents: Sequence[str]) -> Mapping[str, Sequence[float]]:
        """Wait for the command of each agent for this turn."""
        deadline = time.monotonic() + self.parameters.timeout
        found: dict[str, Sequence[float]] = {}
        while True:
            for id in agents:
                if id not in found and (command := self._next(id)) is not None:
                    found[id] = command
            if len(found) == len(agents):
                return {id: found[id] for id in agents}
            if not self._receive(bridge, deadline):
                left = [self._command_topic(id) for id in agents if id not in found]
                raise TimeoutError(
                    f"no command on {', '.join(left[:5])}{', ...' if len(left) > 5 else ''} within "
                    f"{self.parameters.timeout:g} s of wall time (`timeout`)"
                )

    def _latest(self, bridge: Rosbridge, agents: Sequence[str]) -> Mapping[str, Sequence[float]]:
        """Return the latest command of each agent that has a new one."""
        while self._receive(bridge, 0.0):
            pass
        silent = time.monotonic() - bridge.heard
        if silent > self.parameters.timeout:
            raise TimeoutError(f"no command for {silent:.1f} s of wall time (`timeout`)")
        found = {}
        for id in agents:
            waiting = self._waiting.get(self._command_topic(id))
            if waiting:
                found[id] = self._read(id, waiting[-1])[1]
                waiting.clear()
        return found

    def _receive(self, bridge: Rosbridge, deadline: float) -> bool:
        """Store the next message that arrives before a wall time, and return whether there was one."""
        received = bridge.receive(deadline)
        if received is None:
            return False
        topic, content = received
        waiting = self._waiting.setdefault(topic, deque())
        if self.parameters.lock_step and len(waiting) == _MOST_WAITING:
            raise RuntimeError(
                f"{_MOST_WAITING} commands on {topic} wait for their turns: the node sends more than one for each; "
                "`stamped: true` uses those with the time of the turn"
            )
        if not self.parameters.lock_step:
            waiting.clear()
        waiting.append(content)
        return True

    def _next(self, id: str) -> Sequence[float] | None:
        """Return the command of an agent for this turn, if it has arrived; commands with older stamps are dropped."""
        waiting = self._waiting.get(self._command_topic(id))
        while waiting:
            at, command = self._read(id, waiting.popleft())
            if at is None or at == self.now:
                return command
            if at > self.now:
                raise CommandError(
                    f"the command on {self._command_topic(id)} is stamped {at / 1e9:.9g} s, after the time that was "
                    "published"
                )
        return None

    def _read(self, id: str, content: Any) -> tuple[int | None, Sequence[float]]:
        """Return the stamp [ns], if it has one, and the elements of a command."""
        try:
            if not self.parameters.stamped:
                return None, twist(content)
            return stamp(content), twist(content.get("twist"))
        except CommandError as error:
            kind = STAMPED if self.parameters.stamped else TWIST
            raise CommandError(f"the message on {self._command_topic(id)} is no {kind}: {error}") from error

    def captured(self) -> None:
        """Refuse capture while nodes are connected, since their state is not available.

        Raises:
            StateError: Nodes are connected.
        """
        if self._bridge is not None:
            raise StateError("nodes of ROS are connected, whose state cannot be captured")

    def restored(self, state: None) -> None:
        """Do nothing: there is no connection."""

    def _on_end(self, event: Event) -> None:
        # If the run survives the failure of the component, `failed` is fired as well, as a warning.
        if event.name != "failed" or event.level >= Level.ERROR:
            self._close()

    def _close(self) -> None:
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None
