"""Addresses: plain ones are taken, and what is wrong with others is said."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.processes.address import address_of, is_loopback, parse_address
from symaware_cli.processes.transport import TransportError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("127.0.0.1:4321", ("127.0.0.1", 4321)),
        ("localhost:0", ("127.0.0.1", 0)),
        ("4321", ("127.0.0.1", 4321)),
        ("[::1]:65535", ("::1", 65535)),
        ("[0:0::1]:1", ("::1", 1)),
        ("192.0.2.7:80", ("192.0.2.7", 80)),
    ],
)
def test_an_address_has_a_host_and_a_port(text: str, expected: tuple[str, int]) -> None:
    assert parse_address(text) == expected
    assert parse_address(address_of(*expected)) == expected


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no port"),
        ("localhost", "no port"),
        ("127.0.0.1", "no port"),
        ("127.0.0.1:", "no port"),
        ("127.0.0.1:65536", "at most 65535"),
        ("127.0.0.1:-1", "no port"),
        ("127.0.0.1:1_0", "no port"),
        ("127.0.0.1:٣", "no port"),
        (":4321", "no host"),
        ("::1:4321", "brackets"),
        ("[::1]", "brackets"),
        ("robot.example:4321", "not looked up"),
        ("[]:4321", "no IP address"),
        ("[robot]:4321", "not looked up"),
        ("999.0.0.1:1", "no IP address"),
    ],
)
def test_problems_of_an_address_are_reported(text: str, said: str) -> None:
    with pytest.raises(TransportError, match=said):
        parse_address(text)


@given(st.text(max_size=30))
def test_any_text_is_an_address_or_a_transport_error(text: str) -> None:
    try:
        host, port = parse_address(text)
    except TransportError:
        return
    assert parse_address(address_of(host, port)) == (host, port)


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("localhost", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.0.1", False),
        ("::ffff:10.0.0.1", False),
    ],
)
def test_only_this_machine_is_loopback(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
