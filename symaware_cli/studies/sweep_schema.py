"""The JSON schema of files of sweeps, which editors use for completion and validation."""

from __future__ import annotations

from typing import Any

from symaware_cli.language import Catalogue, describe_plugins
from symaware_cli.studies.sweep_document import SweepDocument
from symaware_cli.world import MODIFIERS, RANDOM


def sweep_schema(
    *, built_in_only: bool = False, catalogue: Catalogue | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Generate the schema of files of sweeps, with the parameters of every installed metric.

    Args:
        built_in_only: Whether to omit plugins of other packages.
        catalogue: The installed plugins.

    Returns:
        The schema, and a sentence about each plugin that is omitted because it is broken.
    """
    schema = SweepDocument.model_json_schema(by_alias=True)
    definitions = schema["$defs"]
    broken: list[str] = []
    describe_plugins("metric", ("MetricUse",), definitions, broken, catalogue or Catalogue(), built_in_only)
    # Names are open: most metrics come from plugins, which need not be installed where a file is written.
    definitions["MetricUse"]["properties"]["use"]["anyOf"].append({"type": "string"})
    drawn = definitions["ProbabilityDistribution"]
    for name in (*RANDOM, *MODIFIERS):
        described = drawn["properties"][name]
        if "anyOf" in described:
            # An omitted entry is absent, not null.
            drawn["properties"][name] = {**described.pop("anyOf")[0], **described}
            drawn["properties"][name].pop("default")
    drawn["oneOf"] = [{"required": [name]} for name in RANDOM]
    drawn["dependentRequired"] = {"weights": ["choice"]}
    for entry in schema["properties"].values():
        if "patternProperties" in entry:
            # pydantic describes valid names, but does not forbid others.
            entry["additionalProperties"] = False
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, broken
