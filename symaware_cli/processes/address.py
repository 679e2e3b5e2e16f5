"""Network addresses of hosts. Names other than ``localhost`` are not looked up: the address must be unambiguous."""

from __future__ import annotations

import ipaddress

from symaware_cli.processes.transport import TransportError

_LOCAL = "127.0.0.1"


def parse_address(text: str) -> tuple[str, int]:
    """Split ``HOST:PORT``, ``[HOST]:PORT`` for IPv6, or ``PORT`` alone, which means a port of this machine.

    Returns:
        The host as a numeric address, and the port, 0 to 65535.

    Raises:
        TransportError: The text has none of these forms.
    """
    host, colon, port = text.strip().rpartition(":")
    if colon and not host:
        raise TransportError(f"`{text}` names no host: expected HOST:PORT, such as {_LOCAL}:4321, or PORT alone")
    if ":" in host and not (host.startswith("[") and host.endswith("]")):
        raise TransportError(f"`{text}` is ambiguous: an IPv6 address stands in brackets, such as [::1]:4321")
    # int() takes more than ASCII digits: signs, underscores, spaces.
    if not (port.isascii() and port.isdigit()) or len(port) > 5 or int(port) > 65535:
        raise TransportError(f"`{text}` has no port: expected HOST:PORT with a port of at most 65535")
    if not host:
        return _LOCAL, int(port)
    if host.startswith("[") and host.endswith("]"):
        return numeric(host[1:-1]), int(port)
    return numeric(host), int(port)


def numeric(host: str) -> str:
    """Return a host as a numeric address.

    Raises:
        TransportError: It is a name, or empty.
    """
    if host.lower() == "localhost":
        return _LOCAL
    try:
        return str(ipaddress.ip_address(host))
    except ValueError:
        raise TransportError(
            f"`{host}` is no IP address: write it in numbers, such as 192.0.2.7; names other than localhost are not "
            "looked up"
        ) from None


def address_of(host: str, port: int) -> str:
    """Join a numeric address and a port in the form that `parse_address` reads."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a numeric address, or localhost."""
    address = ipaddress.ip_address(numeric(host))
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback
