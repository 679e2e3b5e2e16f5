"""Export tables that do not depend on time: agents, entities, facts about the run, and descriptions of columns."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.log import Log
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.views.exporting.table import ExportColumn, Table, Values, place_cells, place_columns

AGENTS = Table(
    "agents",
    (
        ExportColumn("agent", "text", "", "its id"),
        ExportColumn("group", "text", "", "the group it belongs to"),
        ExportColumn("model", "text", "", "its dynamics"),
        ExportColumn("shape", "text", "", "its outline, JSON; lengths in m"),
        ExportColumn("mass", "number", "kg", "its mass"),
        ExportColumn("components", "text", "", "its components in the order of their turns, JSON"),
    ),
)
ENTITIES = Table(
    "entities",
    (
        ExportColumn("entity", "text", "", "its name"),
        ExportColumn("shape", "text", "", "its outline, JSON; lengths in m"),
        ExportColumn("mass", "number", "kg", "its mass"),
        *place_columns("position at the beginning"),
        ExportColumn("heading", "number", "rad", "heading at the beginning"),
    ),
)
RUN = Table(
    "run",
    (
        ExportColumn("key", "text", "", "name of the fact"),
        ExportColumn("value", "text", "", "text, or JSON for other values"),
    ),
)
COLUMNS = Table(
    "columns",
    (
        ExportColumn("table", "text", "", "the file, without .csv"),
        ExportColumn("column", "text", "", "the name in its header"),
        ExportColumn("unit", "text", "", "unit of its numbers; empty if not a number or unknown"),
        ExportColumn("description", "text", "", "short description"),
    ),
)


def about(log: Log) -> dict[str, str]:
    """Return facts about a log; values that are not text are JSON."""
    facts: dict[str, Any] = {key: log.manifest.get(key) for key in ("name", "seed", "mode", "time_step", "format")}
    facts["time_step"] = None if facts["time_step"] is None else facts["time_step"] / 1e9  # in s, as all else here
    facts["status"] = (log.outcome or {}).get("status", "broken off")
    facts["versions"] = log.attachments.get("versions.json", b"{}").decode(errors="replace")
    return {key: value if isinstance(value, str) else json.dumps(value) for key, value in facts.items()}


def agent_rows(log: Log, selection: Selection) -> list[Values]:
    """List the agents."""
    rows = [
        (
            agent,
            name,
            group.get("model", {}).get("use", ""),
            json.dumps(group.get("entity", {}).get("shape")),
            group.get("entity", {}).get("mass", np.nan),
            json.dumps(group.get("components", {})),
        )
        for name, group in log.manifest.get("groups", {}).items()
        for agent in group["agents"]
        if selection.has_agent(agent)
    ]
    return AGENTS.values(rows)


def entity_rows(log: Log, selection: Selection) -> list[Values]:
    """List the entities of the environment."""
    rows = [
        (
            name,
            json.dumps(entity.get("shape")),
            entity.get("mass", np.nan),
            *place_cells(entity.get("position", ())),
            entity.get("heading", np.nan),
        )
        for name, entity in log.manifest.get("entities", {}).items()
        if selection.has_agent(name)
    ]
    return ENTITIES.values(rows)


def run_rows(facts: Mapping[str, str]) -> list[Values]:
    """List the facts of `about`."""
    return RUN.values(list(facts.items()))


def column_rows(tables: Sequence[Table]) -> list[Values]:
    """List the columns of tables."""
    return COLUMNS.values(
        [(table.path, column.name, column.unit, column.description) for table in tables for column in table.columns]
    )
