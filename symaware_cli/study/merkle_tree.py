"""The Merkle tree of RFC 6962, section 2.1: one hash that stands for rows in their order."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable


def leaf(content: bytes) -> bytes:
    """Return the hash of a leaf."""
    return hashlib.sha256(b"\0" + content).digest()


def root(leaves: Iterable[bytes]) -> bytes:
    """Return the hash of the tree over the hashes of its leaves, in constant memory but for its depth."""
    # Complete subtrees from left to right, each larger than the next, as (height, hash).
    subtrees: list[tuple[int, bytes]] = []
    for each in leaves:
        height, node = 0, each
        while subtrees and subtrees[-1][0] == height:
            node = _inner(subtrees.pop()[1], node)
            height += 1
        subtrees.append((height, node))
    if not subtrees:
        return hashlib.sha256().digest()
    _, node = subtrees.pop()
    while subtrees:
        node = _inner(subtrees.pop()[1], node)
    return node


def _inner(left: bytes, right: bytes) -> bytes:
    return hashlib.sha256(b"\1" + left + right).digest()
