"""Fails when it is imported, as code with a side effect does."""


def _open_camera() -> None:
    raise OSError("no camera is connected")


_open_camera()
