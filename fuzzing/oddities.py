"""Unusual values for fuzzing: names, numbers, documents."""

from __future__ import annotations

import json
from random import Random
from typing import Any

NAMES = (
    "",
    ".",
    "..",
    "/",
    "/etc/passwd",
    "scenario/",
    "scenario/..",
    "scenario/../../escaped",
    "scenario//absolute",
    "scenario/a\0b",
    "scenario/new\nline.yaml",
    "scenario/" + "long" * 100,
    "scenario/" + "deep/" * 300,
    "scenario/hello.yaml/inside",
    "scenario/resolved.yaml/inside",
    "scenario/C:\\windows",
    "scenario/\u202egnp.exe",
    "scenario/\x1b[31mred",
    "scenario/\u0130\u0131\ufb00\U0001f600",
    "geometry/../../escaped.stl",
    "geometry/a\0.stl",
    "geometry.json",
    "manifest.json",
    "resolved.yaml",
    "versions.json",
    "a" * 70_000,
    "a\0b",
    "\n",
    "\r\x08",
    "\x1b]0;title\x07",
    "/world/robot/state",
    "//",
    "robot",
    "robot.0",
    "*",
    "{}",
    "%s%n",
    "a,b,c",
    "\ud7ff\ue000\ufffe\uffff",
    "con",
    "-",
    "--output",
)
"""Names of attachments, channels, agents and so on."""

NUMBERS: tuple[Any, ...] = (
    *(0, 1, -1, 2, 255, 65_535, 2**31, -(2**31), 2**32, 2**53 + 1, 2**63 - 1, 2**63, -(2**63), 2**64, 10**30, 10**400),
    *(0.5, -0.0, 1e-320, 1e9, 1e308, -1e308, float("inf"), float("nan"), True, False),
)
"""Numbers in JSON; some cannot be converted to others."""


BILLION_LAUGHS = "\n".join(
    [
        "a0: &a0 [x, x, x, x, x, x, x, x, x, x]",
        *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 9)),
    ]
).encode()
"""YAML in which each line expands to ten times the previous one."""


def odd_value(chance: Random) -> Any:
    """An unusual value that JSON can represent."""
    kind = chance.randrange(7)
    if kind == 0:
        return None
    if kind <= 2:
        return chance.choice(NUMBERS)
    if kind == 3:
        return chance.choice(NAMES)
    if kind == 4:
        return chance.choice([[], {}, [[]], [None], [[1, 2], [3]], {"": {}}, [1, "a", None, {}], list(range(1000))])
    if kind == 5:
        return {chance.choice(NAMES): odd_value(chance) for _ in range(3)}
    return [odd_value(chance) for _ in range(chance.randrange(4))]


def altered(value: Any, chance: Random) -> Any:
    """Change a document in one or a few positions, possibly in place."""
    for _ in range(chance.choice([1, 1, 1, 2, 5])):
        places = list(_places(value))
        if not places:
            return odd_value(chance)
        # Prefer values near the top, which have more effect.
        places.sort(key=lambda place: place[2])
        holder, key, _ = places[int(len(places) * chance.random() ** 2)]
        match chance.randrange(6):
            case 0 | 1 | 2:
                holder[key] = odd_value(chance)
            case 3:
                del holder[key]
            case 4 if isinstance(holder, dict):
                holder[chance.choice(NAMES)] = holder.pop(key)
            case 5:
                other, its_key, _ = chance.choice(places)
                if its_key in other if isinstance(other, dict) else its_key < len(other):
                    holder[key] = json.loads(json.dumps(other[its_key]))
            case _:
                holder.append(holder[key]) if isinstance(holder, list) else holder.update({"": holder[key]})
    return value


def _places(value: Any, depth: int = 0) -> list[tuple[Any, Any, int]]:
    if not isinstance(value, dict | list):
        return []
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    found = []
    for key in keys:
        found.append((value, key, depth))
        found += _places(value[key], depth + 1)
    return found


def document(content: bytes, chance: Random) -> bytes:
    """A malicious or damaged document in JSON or YAML, possibly made from a valid one in JSON."""
    kind = chance.randrange(12)
    depth = chance.choice([30, 70, 200, 990, 5_000, 100_000])
    match kind:
        case 0:
            return b"[" * depth
        case 1:
            return b"[" * depth + b"]" * depth
        case 2:
            return b'{"a":' * depth + b"1" + b"}" * depth
        case 3:
            return BILLION_LAUGHS
        case 4:
            return b"a: &a [*a]\nagents: *a\n"
        case 5:
            return chance.choice([b"", b"null", b"1", b'"a"', b"[]", b"{}", b"\xff\xfe", b"\0", b"NaN", b"1e999"])
        case 6:
            return b'{"a": ' + b"9" * chance.choice([20, 400, 4_200, 5_000, 200_000]) + b"}"
        case 7:
            at = chance.randrange(len(content) + 1)
            return content[:at] + chance.randbytes(chance.randrange(20)) + content[at + chance.randrange(20) :]
        case 8:
            return b"? " * min(depth, 5_000) if chance.random() < 0.5 else b"- " * depth
    try:
        return json.dumps(altered(json.loads(content), chance)).encode()
    except (ValueError, RecursionError):
        lines = content.split(b"\n")
        at = chance.randrange(len(lines))
        head, colon, _ = lines[at].partition(b": ")
        value = odd_value(chance)
        lines[at] = head + (colon or b": ") + json.dumps(value).encode()
        return b"\n".join(lines)
