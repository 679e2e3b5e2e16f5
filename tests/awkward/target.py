"""A target whose cases do what their first word says."""

import ctypes
import os
from pathlib import Path
from random import Random

from fuzzing.target import Finding, Target


class Awkward(Target):
    time_limit = 3.0
    memory_limit = 100 << 20
    address_space = 3 << 30

    def prepare(self, folder: Path) -> None:
        assert os.listdir(folder) == []

    def make(self, chance: Random) -> bytes:
        return chance.choice([b"fine", b"fine", b"raises"])

    def attempt(self, case: bytes, folder: Path) -> dict[str, int]:
        assert os.listdir() == []
        (folder / "litter").touch()
        match case.decode():
            case "raises":
                raise ValueError("this must not happen")
            case "finds":
                raise Finding("unreadable", "the log cannot be read")
            case "leaves":
                raise SystemExit(0)
            case "hangs":
                # A case that uses the processor is given less wall time than one that may be waiting for it.
                while True:
                    pass
            case "crashes":
                ctypes.string_at(0)
            case "ends":
                os._exit(0)
            case "eats":
                bytearray(200 << 20)
            case "devours":
                bytearray(8 << 30)
            case other:
                return {other: 1}
        return {}


TARGET = Awkward()
