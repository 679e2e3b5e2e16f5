"""Warnings of MuJoCo end a run: by default the engine only writes them to a file, and resets the state.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from typing import Any

import mujoco

_Warning = mujoco.mjtWarning

_UNSTABLE = "the simulation became unstable: the engine found {} that are not finite or huge; raise `substeps`"
_FULL = "more {} than the engine has memory for; let fewer bodies overlap or touch"

#: The meaning of each warning. Missing ones concern functions that this world does not use.
_MEANINGS = {
    _Warning.mjWARN_BADQPOS: _UNSTABLE.format("positions"),
    _Warning.mjWARN_BADQVEL: _UNSTABLE.format("velocities"),
    _Warning.mjWARN_BADQACC: _UNSTABLE.format("accelerations"),
    _Warning.mjWARN_BADCTRL: _UNSTABLE.format("control inputs of motors"),
    _Warning.mjWARN_CONTACTFULL: _FULL.format("contacts"),
    _Warning.mjWARN_CNSTRFULL: _FULL.format("contacts and joints"),
    _Warning.mjWARN_INERTIA: "the inertia matrix of joints is almost singular: give all moving links a mass",
}

#: The messages of the engine in this process since the last raised warning. Without a function that receives them,
#: MuJoCo would write warnings to a file in the working directory.
_said: list[str] = []
mujoco.set_mju_user_warning(_said.append)


class EngineWarningError(RuntimeError):
    """MuJoCo warned, so its state no longer follows the laws of motion."""


def raise_warnings(data: Any) -> None:
    """Raise the warnings of the engine.

    Args:
        data: The state of a world.

    Raises:
        EngineWarningError: The engine warned of this world since the start of its run.
    """
    # Reading the counters of warnings costs more than a small step; the list may have warnings of other threads'
    # worlds.
    if not _said:
        return
    numbers = data.warning.number
    if numbers.any():
        _said.clear()
        found = [meaning for kind, meaning in _MEANINGS.items() if numbers[int(kind)]]
        raise EngineWarningError("; ".join(found) or "MuJoCo warned")
