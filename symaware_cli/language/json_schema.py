"""The JSON schema of scenarios, which editors use for completion and validation."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import RootModel

from symaware_cli.entry_points import PluginError
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.document import ScenarioDocument, document_of
from symaware_cli.language.fault_section import description_of
from symaware_cli.language.free_places import FreePlacement
from symaware_cli.language.group_templates import LIKE, TEMPLATES
from symaware_cli.language.parts import declared_by, omittable, signals_of
from symaware_cli.language.placement import CirclePlacement, GridPlacement
from symaware_cli.language.scenario_section import SECTION
from symaware_cli.world import RANDOM, VectorDistribution

_USES: Mapping[str, tuple[str, ...]] = {
    "component": ("ComponentUse",),
    "environment": ("EnvironmentUse",),
    "model": ("ModelUse",),
    "topology": ("TopologyUse", "TopologyChange"),
}


def scenario_schema(
    *, built_in_only: bool = False, catalogue: Catalogue | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Generate the schema of scenarios, with the parameters of every installed plugin.

    Args:
        built_in_only: Whether to omit plugins of other packages.
        catalogue: The installed plugins.

    Returns:
        The schema, and a sentence about each plugin that is omitted because it is broken.
    """
    catalogue = catalogue or Catalogue()
    broken: list[str] = []
    loaded = _loaded(SECTION.name, broken, catalogue, built_in_only=built_in_only)
    sections = {key: section for key, section in loaded if key not in ScenarioDocument.model_fields}
    schema = document_of({}, (), sections).model_json_schema(by_alias=True)
    definitions = schema["$defs"]
    kinds = dict(_USES)
    for section in sections.values():
        catalogue.add(section.uses)
        kinds |= {kind.name: (use.__name__,) for kind, use in section.uses.items()}
    declared: set[str] = set()
    substitutes = _describe_faults(definitions, broken, catalogue, built_in_only=built_in_only)
    for kind, uses in {**kinds, "component": (*_USES["component"], *substitutes)}.items():
        for plugin in describe_plugins(kind, uses, definitions, broken, catalogue, built_in_only):
            declared.update(each.name for each in (*declared_by(plugin), *signals_of(plugin)))
    definitions["Recording"]["properties"]["omit"]["items"]["enum"] = omittable(declared)
    _describe_values(schema)
    return _with_bases(schema), broken


def describe_plugins(
    kind: str,
    uses: Sequence[str],
    definitions: dict[str, Any],
    broken: list[str],
    catalogue: Catalogue,
    built_in_only: bool,
) -> list[Any]:
    """Describe the plugins of a kind and their parameters in the definitions of a schema.

    Args:
        kind: The kind, such as ``component``.
        uses: The definitions that refer to a plugin of this kind.
        definitions: The definitions, which are added to.
        broken: Takes a sentence about each plugin that is omitted because it is broken.
        catalogue: The installed plugins.
        built_in_only: Whether to omit plugins of other packages.

    Returns:
        The plugins.
    """
    found, branches, names = [], [], []
    for name, plugin in _loaded(kind, broken, catalogue, built_in_only=built_in_only):
        found.append(plugin)
        names.append({"const": name, "description": (inspect.getdoc(plugin) or "").partition("\n")[0]})
        branches.append(_branch(name, kind, plugin, definitions))
    for use in uses if found else ():
        definitions[use]["properties"]["use"]["anyOf"] = names
        definitions[use]["allOf"] = branches
    return found


def _loaded(kind: str, broken: list[str], catalogue: Catalogue, *, built_in_only: bool) -> Iterator[tuple[str, Any]]:
    """Yield the name and the class of each plugin of a kind; ``broken`` takes a sentence about each that has none."""
    for listing in catalogue.listings(kind):
        if (built_in_only and not listing.built_in) or catalogue.is_shadowed(listing):
            continue
        try:
            yield listing.name, catalogue.load(kind, listing.name)
        except PluginError as error:
            broken.append(str(error))


def _describe_faults(
    definitions: dict[str, Any], broken: list[str], catalogue: Catalogue, *, built_in_only: bool
) -> Sequence[str]:
    """Describe the kinds of faults, which are keys of a fault; return the definitions that name a component."""
    substitutes = []
    for name, plugin in _loaded("fault", broken, catalogue, built_in_only=built_in_only):
        schema = definitions[f"fault:{name}"] = _parameters("fault", name, plugin, definitions)
        if issubclass(plugin.Parameters, RootModel):
            # What a single value means is said at the key.
            schema.pop("description", None)
            _allow_references({"properties": {name: schema}})
        either = [{"$ref": f"#/$defs/fault:{name}"}, {"type": "null"}]
        described = {"default": None, "description": description_of(plugin)}
        definitions["FaultUse"]["properties"][name] = {"anyOf": either, **described}
        if plugin.component_key:
            substitutes.append(f"fault:{name}")
    return substitutes


def _parameters(kind: str, name: str, plugin: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    """The schema of the parameters of a plugin, whose own definitions are added to those of the schema."""
    parameters: dict[str, Any] = plugin.Parameters.model_json_schema(
        by_alias=True, ref_template=f"#/$defs/{kind}:{name}:{{model}}", mode="validation"
    )
    for inner, definition in parameters.pop("$defs", {}).items():
        definitions[f"{kind}:{name}:{inner}"] = definition
    return parameters


def _branch(name: str, kind: str, plugin: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    """The condition that if ``use`` is this plugin, ``with`` has its parameters."""
    parameters = _parameters(kind, name, plugin, definitions)
    key = f"{kind}:{name}"
    definitions[key] = parameters
    branch: dict[str, Any] = {
        "if": {"properties": {"use": {"const": name}}, "required": ["use"]},
        "then": {"properties": {"with": {"$ref": f"#/$defs/{key}"}}},
    }
    if parameters.get("required"):
        branch["then"]["required"] = ["with"]
    if kind == "component":
        names = {"propertyNames": {"enum": [*parameters.get("properties", ())]}}
        branch["then"]["properties"]["own"] = {"additionalProperties": names}
    return branch


def _describe_values(schema: dict[str, Any]) -> None:
    """Describe the forms of values for each agent, and allow ``${parameters.NAME}`` everywhere."""
    definitions = schema["$defs"]
    for model in (GridPlacement, CirclePlacement, FreePlacement):
        definitions[model.__name__] = model.model_json_schema()
    # Numbers may be lists or references here.
    pair = {"type": "array", "minItems": 2, "maxItems": 2}
    drawn = {
        name: {**(pair if field.description.startswith("[") else {}), "description": field.description}
        for name, field in VectorDistribution.model_fields.items()
        if field.description
    }
    forms = {
        "grid": {"$ref": "#/$defs/GridPlacement"},
        "circle": {"$ref": "#/$defs/CirclePlacement"},
        "free": {"$ref": "#/$defs/FreePlacement"},
        "each": {"type": "array", "description": "One value for each agent, in the order of their index."},
        "all": {"description": "One value that all agents share."},
    }
    definitions["PerAgent"] = {
        "anyOf": [
            {"type": ["number", "string", "boolean", "array", "null"]},
            {
                "type": "object",
                "properties": forms,
                "minProperties": 1,
                "maxProperties": 1,
                "additionalProperties": False,
            },
            {
                "type": "object",
                "properties": drawn,
                "oneOf": [{"required": [form]} for form in RANDOM],
                "additionalProperties": False,
            },
            {"type": "object", "not": {"anyOf": [{"required": [form]} for form in (*RANDOM, *forms)]}},
        ]
    }
    agents = definitions["GroupSection"]["properties"]
    name = {"type": "string", "description": "The name of a template or of a group."}
    agents[LIKE] = {
        "description": "A template or another group, or several, whose keys this one has, with its own merged into "
        "them; null removes a key.",
        "anyOf": [name, {"type": "array", "items": name}],
    }
    partial = {"$ref": "#/$defs/partial:GroupSection"}
    whole = {"if": {"required": [LIKE]}, "then": partial, "else": {"$ref": "#/$defs/GroupSection"}}
    groups = schema["properties"]["agents"]
    schema["properties"][TEMPLATES] = {
        "type": "object",
        "description": "Templates of groups, for `like`, by name: keys of groups.",
        "patternProperties": dict.fromkeys(groups["patternProperties"], partial),
    }
    groups["patternProperties"] = dict.fromkeys(groups["patternProperties"], whole)
    agents["state"]["$ref"] = "#/$defs/PerAgent"
    for pattern in agents["knowledge"]["patternProperties"]:
        agents["knowledge"]["patternProperties"][pattern] = {"$ref": "#/$defs/PerAgent"}
    schema["properties"]["extends"] = {
        "description": "A file, or a list of files, below this one's folder that this one changes.",
        "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}],
    }
    for definition in [schema, *definitions.values()]:
        _allow_references(definition)
        for entry in definition.get("properties", {}).values():
            if "patternProperties" in entry:
                # pydantic describes valid names, but does not forbid others.
                entry["additionalProperties"] = False


def _with_bases(schema: dict[str, Any]) -> dict[str, Any]:
    """Allow a file that extends another to omit required keys, and to remove inherited ones with null."""
    definitions = schema.pop("$defs")
    partial = {f"partial:{name}": _partial(each) for name, each in definitions.items() if name not in _WHOLE}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": schema["title"],
        "description": schema["description"],
        "if": {"required": ["extends"]},
        "then": {"$ref": "#/$defs/partial:ScenarioDocument"},
        "else": {"$ref": "#/$defs/ScenarioDocument"},
        "$defs": {**definitions, "ScenarioDocument": schema, **partial, "partial:ScenarioDocument": _partial(schema)},
    }


#: Definitions of values that are not merged but replaced.
_WHOLE = ("PerAgent", "GridPlacement", "CirclePlacement", "FreePlacement")
_NULL = {"type": "null"}


def _partial(node: dict[str, Any]) -> dict[str, Any]:
    """Return a schema without its required fields, in which every value may be null."""
    changed: dict[str, Any] = {}
    for key, value in node.items():
        if key == "$ref":
            name = value.rpartition("/")[2]
            changed[key] = value if name in _WHOLE or name.startswith("partial:") else f"#/$defs/partial:{name}"
        elif key in ("properties", "patternProperties"):
            changed[key] = {name: {"anyOf": [_partial(each), _NULL]} for name, each in value.items()}
        elif key in ("anyOf", "allOf", "oneOf"):
            changed[key] = [_partial(each) for each in value]
        elif key in ("then", "else", "items", "additionalProperties") and isinstance(value, dict):
            changed[key] = _partial(value)
        elif key != "required":
            changed[key] = value
    return changed


def _allow_references(node: Any) -> None:
    """Allow a reference wherever a number or a flag is allowed."""
    reference = {"type": "string", "pattern": r"\$\{parameters\."}
    for entry in node.get("properties", {}).values():
        if entry.get("type") in ("number", "integer", "boolean"):
            described = {key: entry.pop(key) for key in ("title", "description", "default") if key in entry}
            plain = dict(entry)
            entry.clear()
            entry.update({"anyOf": [plain, reference], **described})
        elif "anyOf" in entry and any(each.get("type") in ("number", "integer", "boolean") for each in entry["anyOf"]):
            entry["anyOf"].append(reference)
