"""The overview of a log, for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli.api.report import size_in_words
from symaware_cli.cli.terminal import printable
from symaware_cli.recording.overview import Overview

#: How many columns of a channel are named.
_MOST = 9


def text(summary: Overview) -> str:
    """Lay out the overview of a log."""
    lines = [f"{summary.path}: {size_in_words(summary.size)}, {summary.status}"]
    if summary.foreign:
        lines.append(_line("origin", "not written by SymAware; only its channels can be shown"))
    else:
        known = summary.name is not None
        lines.append(
            _line("scenario", f"{summary.name}, seed {summary.seed}, {summary.mode}" if known else "not known")
        )
        groups = ", ".join(f"{name} ({count})" for name, count in summary.agents.items()) or "none"
        lines.append(_line("agents", groups))
        if summary.entities:
            lines.append(_line("entities", ", ".join(summary.entities)))
    if summary.simulated_time is not None:
        steps = f", {summary.steps:,} steps" if summary.steps is not None else ""
        step = f" of {summary.time_step:g} s" if steps and summary.time_step else ""
        wall = f"; {summary.wall_time:.2f} s of wall time" if summary.wall_time is not None else ""
        lines.append(_line("time", f"0 to {summary.simulated_time:.9g} s{steps}{step}{wall}"))
    if summary.events:
        lines.append(_line("events", ", ".join(f"{name} {count}" for name, count in summary.events.items())))
    lines += [_line(each.verdict, str(each)) for each in summary.specifications]
    if summary.scenario:
        lines.append(_line("attached", ", ".join(summary.scenario)))
    if summary.versions:
        own = [f"{name} {summary.versions[name]}" for name in ("symaware-cli", "numpy") if name in summary.versions]
        lines.append(_line("versions", f"{', '.join(own)} and {len(summary.versions) - len(own)} more (--json)"))
    if "Processor" in summary.versions:
        lines.append(_line("computed", _computed(summary.versions)))
    if summary.recovered:
        lines.append(_line("recovered", summary.recovered))
    if summary.damage:
        lines.append(_line("damage", summary.damage))
    gaps = [(channel.topic, gap) for channel in summary.channels for gap in channel.gaps]
    for topic, gap in gaps[:5]:
        lines.append(_line("gap", f"{topic} has nothing between {gap.after:g} s and {gap.until:g} s"))
    if len(gaps) > 5:
        lines.append(_line("gap", f"and {len(gaps) - 5} more (--json)"))
    return "\n".join([*lines, "", *_channels(summary)])


def _computed(versions: Mapping[str, str]) -> str:
    """The processor and libraries that computed the run, as far as they were recorded."""
    by = [f"NumPy {versions.get('NumPy kernels', 'unknown')}", versions.get("BLAS"), versions.get("C library")]
    pinned = versions.get("Pinned", "yes")
    return (
        f"on {versions['Processor']} by {', '.join(filter(None, by))}{'' if pinned == 'yes' else f'; pinned: {pinned}'}"
    )


def _channels(summary: Overview) -> list[str]:
    width = max((len(printable(channel.topic)) for channel in summary.channels), default=0)
    lines = [f"  {'channel':<{width}}  {'messages':>9}  {'rate':>9}  {'size':>8}  content"]
    for channel in summary.channels:
        rate = f"{channel.rate:.4g} Hz" if channel.rate else "-"
        content = printable(f"{channel.schema.rpartition('.')[2]} {_listed(channel.columns)}".rstrip())
        size = size_in_words(channel.size)
        lines.append(f"  {printable(channel.topic):<{width}}  {channel.messages:>9,}  {rate:>9}  {size:>8}  {content}")
    return lines


def _line(label: str, text: str) -> str:
    return f"  {label:<9} {printable(text)}"


def _listed(names: Sequence[str]) -> str:
    """The names, or the first few of many."""
    if len(names) <= _MOST + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_MOST])} and {len(names) - _MOST} more"
