"""Damages bytes: flips bits; removes, repeats or replaces parts; falsifies lengths."""

from collections.abc import Sequence
from random import Random


def damaged(content: bytes, others: Sequence[bytes], chance: Random) -> bytes:
    """Damage the content of a file in one way.

    Args:
        content: The content.
        others: Other contents from which parts may be inserted.
        chance: The random number generator.
    """
    data = bytearray(content)
    place = chance.randrange(len(data))
    length = min(int(2 ** chance.uniform(0, 14)), len(data) - place)
    match chance.randrange(8):
        case 0 | 1:
            for _ in range(chance.choice([1, 1, 2, 8, 100])):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        case 2:
            del data[place:]
        case 3:
            del data[place : place + length]
        case 4:
            other = chance.choice(list(others) or [content])
            start = chance.randrange(len(other))
            data[place : place + length * chance.randrange(2)] = other[start : start + length]
        case 5:
            data[place:place] = data[place : place + length] * chance.choice([1, 1, 10])
        case 6:
            data[place : place + length] = chance.choice([bytes(length), b"\xff" * length, chance.randbytes(length)])
        case 7:
            # Overwrite a number, which may be a length.
            width = chance.choice([1, 2, 4, 8])
            number = chance.choice([0, 1, 2**7, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1])
            data[place : place + width] = (number % 256**width).to_bytes(width, "little")
    return bytes(data)
