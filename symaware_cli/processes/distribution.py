"""Creates the host or member of a run in several processes from the requested role, with checks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from symaware_cli.engine import further_parts
from symaware_cli.language import nearest
from symaware_cli.language.build import Built
from symaware_cli.processes.address import is_loopback, parse_address
from symaware_cli.processes.checkpoint_file import CheckpointFile
from symaware_cli.processes.distribution_error import DistributionError
from symaware_cli.processes.host import Host
from symaware_cli.processes.member import Member
from symaware_cli.processes.participant import Identity, Participant
from symaware_cli.processes.transport import Transport
from symaware_cli.processes.transport_section import TRANSPORT
from symaware_cli.version import __version__
from symaware_cli.world import InstalledPlugins

#: The transport used if the scenario names none.
_DEFAULT = "tcp"

#: The least length of a key in bytes.
_LEAST_KEY = 16

#: How long a member waits for a host that is gone, in multiples of the transport's `timeout`.
_ABSENCE = 5.0


class Asked(Protocol):
    """The requested role of a process in a run: the attributes of `Place`."""

    @property
    def role(self) -> str:
        """``host`` or ``member``."""

    @property
    def address(self) -> str:
        """The address of the host."""

    @property
    def only(self) -> Sequence[str]:
        """The agents that the process runs."""

    @property
    def name(self) -> str | None:
        """The name of the process."""

    @property
    def key(self) -> Path | None:
        """A file with the shared key."""

    @property
    def patience(self) -> float:
        """The time to wait for other processes before the run begins [s]."""


def participant(built: Built, place: Asked, log: Path | None = None) -> Participant:
    """Create the participant of this process in a run of several processes; a host listens from now on.

    Args:
        built: The scenario.
        place: The role of this process.
        log: The log; a member stores its state beside it.

    Raises:
        DistributionError: This process cannot have that role.
        TransportError: The transport cannot listen at that address.
    """
    try:
        host, port = parse_address(place.address)
    except ValueError as error:
        raise DistributionError(str(error)) from None
    environment = built.simulation.environment
    if not environment.is_shared:
        use = built.simulation.environment_use
        raise DistributionError(f"the world `{use}` cannot be copied to other processes")
    if built.options.until is not None:
        names = {*further_parts(built.simulation.groups)} & {*built.options.until.names}
        if names:
            raise DistributionError(
                f"`run.until` uses `{min(names)}`, which only the process that runs the agent has, not the host"
            )
    if built.options.presence:
        groups = ", ".join(f"`agents.{name}.present`" for name in sorted(built.options.presence))
        raise DistributionError(f"agents can enter and leave only in runs of one process: {groups}")
    believed = [each.name for each in built.options.specifications if each.of != "truth"]
    if believed:
        said = "is about beliefs, which only the processes that run the agents have, not the host"
        raise DistributionError(f"the specification `{believed[0]}` {said}")
    offered = [each.name for each in built.options.specifications if each.offer is not None]
    if offered:
        said = "is offered while the run goes on, and only the process that runs the agent could accept it"
        raise DistributionError(f"the specification `{offered[0]}` {said}")
    agents = _chosen(built, place)
    key = None if place.key is None else _key(place.key)
    if key is None and not is_loopback(host):
        reached = "listen at" if place.role == "host" else "join"
        raise DistributionError(
            f"to {reached} {host}, which other machines can reach, all processes must share a key: --key-file FILE"
        )
    transport = _transport(built)
    usual = "host" if place.role == "host" else "+".join(each.removeprefix("agents.") for each in place.only)
    identity = Identity(place.name or usual, built.digest, __version__, agents)
    if place.role == "host":
        # A busy machine needs more than a moment for the start of a process. Until then a connection costs little: if
        # there are too many, the port closes those that are not members.
        silence = transport.parameters.hang_timeout
        return Host(identity, transport.listen(host, port, key), place.patience, silence)
    absence = _ABSENCE * transport.parameters.timeout
    checkpoints = None if log is None else CheckpointFile(log.parent, built.simulation.name, identity)
    return Member(identity, transport.join(host, port, key), place.patience, absence, checkpoints)


def part(place: Asked, participant: Participant) -> dict[str, Any]:
    """The description of a process's part of the run for the manifest of its log."""
    identity = participant.identity
    return {"name": identity.name, "host": place.role == "host", "agents": list(identity.agents)}


def _chosen(built: Built, place: Asked) -> tuple[str, ...]:
    """The ids of the agents that a process runs, in the order of the roster."""
    roster = built.simulation.environment.roster
    chosen: set[int] = set()
    for pattern in place.only:
        wanted = pattern.removeprefix("agents.")
        try:
            chosen.update(roster.matching(wanted))
        except KeyError:
            near = nearest(wanted, [*roster.groups, *roster.ids])
            hint = f"; did you mean `agents.{near}`?" if near else ""
            raise DistributionError(f"--only names `{pattern}`, and there is no such agent or group{hint}") from None
    if place.role == "member" and not chosen:
        raise DistributionError("a process that joins must run some of the agents; select them with --only")
    if place.role == "host" and len(chosen) == len(roster):
        raise DistributionError("--only selects all agents, so there are none for other processes to run")
    return tuple(roster.ids[index] for index in sorted(chosen))


def _key(path: Path) -> bytes:
    try:
        key = path.read_bytes().strip()
    except OSError as error:
        raise DistributionError(f"the key cannot be read: {path}: {error.strerror}") from error
    if len(key) < _LEAST_KEY:
        raise DistributionError(f"the key in {path} has {len(key)} bytes; it needs at least {_LEAST_KEY}")
    return key


def _transport(built: Built) -> Transport:
    transport: Transport | None = built.sections.get("transport")
    return InstalledPlugins([TRANSPORT]).load(TRANSPORT.name, _DEFAULT)() if transport is None else transport
