"""What a transport is; see `symaware_cli.core.transport`, to which this moved."""

from symaware_cli.core.transport import Happening, Port, Rejection, Transport, TransportError

__all__ = ["Happening", "Port", "Rejection", "Transport", "TransportError"]
