"""Reads the test bags of ros2/rosbag2 and compares them with `rosbags`, or says why they are refused.

`python benchmarks/rosbag2_bags.py FOLDER` prints a row for each .mcap and .db3 file in a checkout of
https://github.com/ros2/rosbag2, and ends with status 1 if something differs: the number of messages on each topic, and
the time and the bytes of each message. The bags are not part of this repository.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Reader

from symaware_cli.assets import AssetFolders
from symaware_cli.bags.bag import Bag
from symaware_cli.bags.bag_error import BagError
from symaware_cli.core import WorldError


def theirs(path: Path) -> list[tuple[str, int, bytes]]:
    """Return topic, time and content of each message, as `rosbags` reads the file."""
    with Reader(path) as reader:
        return sorted((each.topic, time, bytes(data)) for each, time, data in reader.messages())


def compared(path: Path) -> tuple[str, bool]:
    """Return what became of a file, and whether it is right."""
    try:
        bag = Bag(path.name, AssetFolders(path.parent))
    except (BagError, WorldError) as error:
        return f"refused: {error}", True
    found = sorted(bag.messages(list(bag.topics)))
    span = f"{bag.start} to {bag.end} ns" if found else "none"
    counts_fit = sum(topic.count for topic in bag.topics.values()) == len(found)
    try:
        expected: Any = theirs(path)
    except Exception as error:  # whatever it raises, it is the other reader that refuses
        return f"{len(found)} messages, {span} (`rosbags`: {error})", counts_fit
    same = found == expected and counts_fit
    return f"{len(found)} messages on {len(bag.topics)} topics, {span}{'' if same else ': DIFFERS'}", same


def main() -> int:
    """Compare all bags below a folder."""
    folder = Path(sys.argv[1])
    files = sorted(path for path in folder.rglob("*") if path.suffix in (".mcap", ".db3"))
    right = 0
    for path in files:
        said, fits = compared(path)
        right += fits
        print(f"{path.relative_to(folder)}: {said}")
    print(f"{right} of {len(files)} read with the right times, or refused by name")
    return 0 if right == len(files) else 1


if __name__ == "__main__":
    sys.exit(main())
