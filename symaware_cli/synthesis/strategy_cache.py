"""Keeps strategies from run to run, by the content of the game that they are for."""

from __future__ import annotations

import hashlib
import os
import struct
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from symaware_cli.synthesis.game import Game
from symaware_cli.synthesis.strategy import Strategy
from symaware_cli.synthesis.vocabulary import Variable
from symaware_cli.version import __version__

#: The environment variable that names the folder of the cache; empty for none.
VARIABLE = "SYMAWARE_CACHE"
#: How many strategies are kept; those that were used the longest time ago are removed.
_MOST_FILES = 200
#: Counts changes of the solver or of this format that make older files useless.
_FORMAT = 2
#: Follows a strategy in its file: its effort, and the SHA-256 of all before.
_END = struct.Struct("<Q32s")


class StrategyCache:
    """Strategies in files of a folder, one for each game. Whatever is read from it has to be checked before use.

    A file that cannot be read or written is none: without the cache a strategy is made again.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @classmethod
    def of_user(cls) -> StrategyCache | None:
        """Return the cache of the user of this machine; None if there shall be none."""
        given = os.environ.get(VARIABLE)
        if given is not None:
            return cls(Path(given)) if given else None
        with suppress(RuntimeError):  # a user without a home
            return cls(_user_folder() / "symaware" / "strategies")
        return None

    def strategy(self, game: Game) -> Strategy | None:
        """Return the strategy for a game; None if there is none, or its file is damaged."""
        path = self._path(game)
        try:
            file = path.read_bytes()
            content, end = file[: -_END.size], file[-_END.size :]
            effort, digest = _END.unpack(end)
            if hashlib.sha256(file[:-32]).digest() != digest:
                return None
            strategy = replace(decoded(content, game), effort=effort)
        except (OSError, ValueError, struct.error):
            return None
        with suppress(OSError):
            os.utime(path)
        return strategy

    def keep(self, strategy: Strategy) -> None:
        """Keep a strategy."""
        path = self._path(strategy.game)
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            # Written elsewhere first, so that whoever reads at the same time never sees a part of it.
            handle, name = tempfile.mkstemp(dir=self._folder)
            with os.fdopen(handle, "wb") as file:
                file.write(_file(strategy))
            os.replace(name, path)
            files = sorted(self._folder.glob("*.strategy"), key=lambda each: each.stat().st_mtime_ns)
            for each in files[:-_MOST_FILES]:
                each.unlink()

    def _path(self, game: Game) -> Path:
        return self._folder / f"{game_digest(game)}.strategy"


def _file(strategy: Strategy) -> bytes:
    content = encoded(strategy) + struct.pack("<Q", strategy.effort)
    return content + hashlib.sha256(content).digest()


def game_digest(game: Game) -> str:
    """Return the SHA-256 of all that a game consists of and of the version of this program, in hexadecimal."""
    parts = [_FORMAT, __version__, [_content(each) for each in (game.vocabulary.cell, *game.vocabulary.environment)]]
    parts += [[each.text for each in statements] for statements in (game.assumptions, game.guarantees)]
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _content(variable: Variable) -> Sequence[object]:
    system = variable.system
    if system is None:
        return (variable.name,)
    labels = [(name, sorted(where)) for name, where in sorted(system.labels.items())]
    return (variable.name, system.states, system.initial, system.successors, labels)


def encoded(strategy: Strategy) -> bytes:
    """Return a strategy as bytes: the choices as little-endian 32-bit integers, then the bits of what is reached."""
    choices = np.ascontiguousarray(strategy.choices, "<i4").tobytes()
    return choices + np.packbits(strategy.reached).tobytes()


def decoded(content: bytes, game: Game) -> Strategy:
    """Return the strategy for a game from its bytes.

    Raises:
        ValueError: They are not those of a strategy for this game.
    """
    shape = (max(len(game.goals(game.guarantees)), 1), game.size)
    count = shape[0] * shape[1]
    if len(content) != 4 * count + (count + 7) // 8:
        raise ValueError("the file has not the size of a strategy for this game")
    choices = np.frombuffer(content, "<i4", count).astype(np.int32).reshape(shape)
    if choices.min() < -1 or choices.max() >= game.vocabulary.cell.size:
        raise ValueError("the file has cells that are none of this game")
    reached = np.unpackbits(np.frombuffer(content, np.uint8, offset=4 * count), count=count).astype(bool)
    return Strategy(game, choices, reached.reshape(shape))


def _user_folder() -> Path:
    """Return where programs keep what can be made again, for the present user."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
