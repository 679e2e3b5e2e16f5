"""The gallery: a page for each scenario of the checkout, with what it shows and a picture of its run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath

import yaml
from pages import Pages

from symaware_cli import LogError, open_log
from symaware_cli.views import PlotRequest, plot

#: Where scenarios are, with a heading; names that begin with an underscore are those of bases for others.
_PLACES = {"scenarios": "Of the core", "plugins/*/scenarios": "Of plugins"}

_SUFFIXES = (".yaml", ".toml")

#: Pictures are shown in two sizes; this is the larger one.
_SIZE, _DPI = (5.2, 4.4), 80

#: Exit statuses of a run that came to its end: finished, and finished with a violated specification.
_ENDED = (0, 3)

#: Of a scenario that is invalid, here because its plugin is not installed.
_INVALID = 2


class GalleryError(Exception):
    """A scenario of the checkout does not run."""


def scenarios(checkout: Path) -> list[PurePosixPath]:
    """Return all scenarios of a checkout, those of plugins last."""
    found = [path for place in _PLACES for path in sorted(checkout.glob(f"{place}/*")) if path.suffix in _SUFFIXES]
    return [PurePosixPath(path.relative_to(checkout).as_posix()) for path in found if not path.name.startswith("_")]


def page(scenario: PurePosixPath) -> PurePosixPath:
    """Return the page of a scenario."""
    return PurePosixPath("gallery", *_plugin(scenario), f"{scenario.stem}.md")


def log_name(scenario: PurePosixPath) -> str:
    """Return what the log of a scenario is called among those of all scenarios."""
    return "-".join(scenario.with_suffix(".mcap").parts)


def write(pages: Pages, logs: Path | None) -> None:
    """Write the gallery.

    Args:
        pages: The pages of the site, which already know the page of each scenario.
        logs: A folder of logs of the scenarios, called as `log_name` says; those that it does not have are made there.
            None for a gallery without pictures.

    Raises:
        GalleryError: A scenario whose plugins are installed does not run to its end.
    """
    found = scenarios(pages.checkout)
    drawn: list[PurePosixPath] = []
    if logs is not None:
        logs.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            made = list(pool.map(lambda each: _run(pages.checkout, each, logs / log_name(each)), found))
        for scenario, is_there in zip(found, made, strict=True):
            if is_there:
                _draw(logs / log_name(scenario), scenario.stem, pages.target / _picture(scenario))
                drawn.append(scenario)
            else:
                print(f"{scenario}: no picture, because its plugin is not installed")
    for scenario in found:
        pages.put(page(scenario), _page(pages, scenario, is_drawn=scenario in drawn))
    pages.put(PurePosixPath("gallery/index.md"), _overview(pages, found, drawn))


def _run(checkout: Path, scenario: PurePosixPath, log: Path) -> bool:
    """Run a scenario unless its log is there; return whether there is a log."""
    if log.exists():
        return True
    command = [sys.executable, "-P", "-m", "symaware_cli", "run", str(scenario), "--output", str(log), "--quiet"]
    done = subprocess.run(command, cwd=checkout, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode == _INVALID and scenario.parts[0] == "plugins":
        return False
    if done.returncode not in _ENDED:
        raise GalleryError(f"{scenario} does not run:\n{done.stdout}{done.stderr}")
    return True


def _draw(log: Path, title: str, picture: Path) -> None:
    picture.parent.mkdir(parents=True, exist_ok=True)
    opened = open_log(log)
    try:
        plot(opened, picture, PlotRequest(show=("trajectories",), title=title, size=_SIZE, dpi=_DPI))
    except LogError:
        # Agents without a place have no trajectories.
        plot(opened, picture, PlotRequest(title=title, size=_SIZE, dpi=_DPI))


def _plugin(scenario: PurePosixPath) -> Sequence[str]:
    return scenario.parts[1:2] if scenario.parts[0] == "plugins" else ()


def _picture(scenario: PurePosixPath) -> PurePosixPath:
    return page(scenario).with_suffix(".png")


def _text(pages: Pages, scenario: PurePosixPath) -> str:
    return (pages.checkout / scenario).read_text(encoding="utf-8")


def _description(text: str) -> str:
    """Return what a scenario says about itself: its description, or the comment at its beginning."""
    if found := re.search(r"(?m)^description: >\n((?:  .*\n)+)", text):
        return " ".join(found[1].split())
    if found := re.search(r"(?m)^description: (?!>)(.*)$", text):
        return str(yaml.safe_load(found[1]))
    lines: list[str] = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if not line.startswith(("# yaml-language-server", "#:schema")):
            lines.append(line.removeprefix("#").removeprefix(" "))
    return "\n".join(lines).strip()


def _page(pages: Pages, scenario: PurePosixPath, *, is_drawn: bool) -> str:
    text = _text(pages, scenario)
    parts = [f"# {scenario.stem}", _description(text)]
    if is_drawn:
        parts.append(f"![The run of {scenario.stem} from above]({_picture(scenario).name})")
    if _plugin(scenario):
        parts.append(f"It needs the plugin `{_plugin(scenario)[0]}`: `pip install ./plugins/{_plugin(scenario)[0]}`.")
    parts.append(f"```sh\nsymaware run {scenario}\nsymaware replay {scenario.stem}.mcap\n```")
    language = scenario.suffix.removeprefix(".")
    parts.append(f"```{language}\n{text.rstrip()}\n```")
    return "\n\n".join(part for part in parts if part) + "\n"


def _overview(pages: Pages, found: Sequence[PurePosixPath], drawn: Sequence[PurePosixPath]) -> str:
    groups: Mapping[str, list[PurePosixPath]] = {
        heading: [each for each in found if each.match(f"{place}/*")] for place, heading in _PLACES.items()
    }
    parts = ["# Gallery", "Every scenario in this repository, with its trajectories as `symaware plot` draws them."]
    for heading, members in groups.items():
        parts.append(f"## {heading}")
        entries = []
        for scenario in members:
            place = page(scenario).relative_to("gallery")
            name = "/".join((*_plugin(scenario), scenario.stem))
            if scenario in drawn:
                alternative = f"The run of {scenario.stem} from above"
                entries.append(f"[![{alternative}]({place.with_suffix('.png')})]({place}) [{name}]({place})")
            else:
                entries.append(f"[{name}]({place})")
        parts.append("\n".join(f"- {entry}" for entry in entries))
    return "\n\n".join(parts) + "\n"
