"""Video files: GIF and WebP by Pillow, MP4 by the program ffmpeg if it is installed."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import LogError, OutputError, UnknownNameError, require_writable_file
from symaware_cli.views.palette import Colour

if TYPE_CHECKING:
    from PIL.Image import Image

Pixels = NDArray[np.uint8]

#: The formats, by suffix.
VIDEO_FORMATS = (".gif", ".webp", ".mp4")

#: Pictures per second: the delays of a GIF are multiples of 10 ms.
RATE = 20

#: Number of colours of the first frame in the palette of a GIF, which has 256.
_USUAL = 64

#: Number of shades between a colour and the background in the palette of a GIF, for edges.
_EDGES = (1.0, 0.75, 0.5, 0.3, 0.15)


def check_video(path: Path) -> None:
    """Check that a video can be written in the format of the file's suffix.

    Raises:
        UnknownNameError: The suffix is not one of `VIDEO_FORMATS`.
        LogError: The format needs a program that is not installed.
        OutputError: The file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in VIDEO_FORMATS:
        what = f"the suffix {path.suffix!r}" if path.suffix else "a name without a suffix"
        message = f"cannot make {path}: {what} is not a known format; use {', '.join(VIDEO_FORMATS[:-1])} or .mp4"
        raise UnknownNameError(message, suffix, VIDEO_FORMATS)
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise LogError("videos of the format .mp4 need the program `ffmpeg`, which is not installed; .gif needs none")
    require_writable_file(path)


def write_video(path: Path, suffix: str, frames: Iterable[Pixels], colours: Sequence[Colour]) -> None:
    """Write frames, `RATE` per second, to a file; the same frames and versions give the same bytes.

    Args:
        path: The file.
        suffix: The format, one of `VIDEO_FORMATS`.
        frames: The frames, each (height, width, 3).
        colours: The colours that occur, for formats with few colours; the first one is the background.

    Raises:
        OutputError: ffmpeg fails.
    """
    if suffix == ".mp4":
        _encode(path, frames)
        return
    from PIL import Image

    given: dict[str, Any] = {"save_all": True, "duration": 1000 // RATE, "loop": 0}
    images: Iterator[Image.Image] = (Image.fromarray(frame, "RGB") for frame in frames)
    if suffix == ".gif":
        frames = iter(frames)
        opening = next(frames)
        images = (Image.fromarray(frame, "RGB") for frame in chain([opening], frames))
        palette = _palette(colours, opening)
        images = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
        given |= {"optimize": False, "disposal": 1}
        next(images).save(path, format="GIF", append_images=images, **given)
    else:
        first, *others = images  # Pillow counts the frames first
        first.save(path, format="WEBP", append_images=others, quality=80, method=4, **given)


def _palette(colours: Sequence[Colour], opening: Pixels) -> Image:
    """Return an image with a palette: the usual colours of the first frame, the given ones, and their edges."""
    from PIL import Image

    background = np.array(colours[0], float)
    mixed = [background + share * (np.array(colour, float) - background) for share in _EDGES for colour in colours]
    found, counts = np.unique(opening.reshape(-1, 3), axis=0, return_counts=True)
    usual = found[np.argsort(-counts, kind="stable")][:_USUAL]
    chosen = list(dict.fromkeys(tuple(int(part) for part in np.round(each)) for each in [*usual, *mixed]))[:256]
    entries = list(chain.from_iterable(chosen))
    image = Image.new("P", (1, 1))
    image.putpalette(entries + entries[:3] * (256 - len(chosen)))
    return image


def _encode(path: Path, frames: Iterable[Pixels]) -> None:
    """Encode frames by ffmpeg.

    Raises:
        OutputError: The program fails.
    """
    frames = iter(frames)
    first = next(frames)
    height, width, _ = first.shape
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{RATE}", "-i", "-"]
    # One thread, and neither dates nor versions in the file, so that the same frames give the same bytes.
    exact = ["-threads", "1", "-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact"]
    target = ["-an", "-pix_fmt", "yuv420p", *exact, "-f", "mp4", "-y", str(path)]
    command = ["ffmpeg", "-loglevel", "error", *source, *target]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stdin is not None
    try:
        for frame in chain([first], frames):
            process.stdin.write(frame.tobytes())
    except BrokenPipeError:
        pass  # its error output gives the reason
    except BaseException:
        process.kill()
        process.wait()
        raise
    _, said = process.communicate()
    if process.returncode:
        raise OutputError(f"ffmpeg cannot make the video: {said.decode(errors='replace').strip()[-500:]}")
