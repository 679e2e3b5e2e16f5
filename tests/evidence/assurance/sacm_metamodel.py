"""The part of the metamodel SACM 2.3 that assurance cases use, as a table, and a check of files against it.

Source: the EMOF model of SACM 2.3 and the Ecore models (for the namespaces) that the SACM revision task force of the
OMG published, https://github.com/SystemsAssuranceGroup/SACM, commit eb93642. Where they differ, the stricter bound is
here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple
from xml.etree import ElementTree

XMI, XSI = "http://www.omg.org/XMI", "http://www.w3.org/2001/XMLSchema-instance"
NAMESPACES: Mapping[str, str] = {
    "assuranceCase_": "http://omg.sacm/2.3/assurancecase",
    "argumentation_": "http://omg.sacm/2.3/argumentation",
    "artifact_": "http://omg.sacm/2.3/artifact",
}
DECLARATIONS = ("asserted", "needsSupport", "assumed", "axiomatic", "defeated", "asCited")


class Feature(NamedTuple):
    """A feature of a class: an attribute, a reference, or contained elements.

    Attributes:
        type: The class, or for attributes the values: ``text``, ``truth`` or ``declaration``.
        lower: The least number of values.
        upper: The greatest number of values.
        contained: Whether values are child elements.
    """

    type: str
    lower: int
    upper: int
    contained: bool = False


MANY = 10**9

#: The superclass of each class, and its own features.
CLASSES: Mapping[str, tuple[str | None, Mapping[str, Feature]]] = {
    "Element": (None, {}),
    "SACMElement": ("Element", {"gid": Feature("text", 0, 1)}),
    "ModelElement": (
        "SACMElement",
        {"name": Feature("LangString", 1, 1, True), "description": Feature("Description", 0, 1, True)},
    ),
    "LangString": ("Element", {"lang": Feature("text", 0, 1), "content": Feature("text", 0, 1)}),
    "MultiLangString": ("Element", {"value": Feature("LangString", 1, MANY, True)}),
    "UtilityElement": ("SACMElement", {"content": Feature("MultiLangString", 1, 1, True)}),
    "Description": ("UtilityElement", {}),
    "ArtifactElement": ("ModelElement", {}),
    "ArtifactPackage": ("ArtifactElement", {"artifactElement": Feature("ArtifactElement", 0, MANY, True)}),
    "Artifact": ("ArtifactElement", {"version": Feature("text", 0, 1), "date": Feature("text", 0, 1)}),
    "AssuranceCasePackage": (
        "ArtifactElement",
        {
            "argumentPackage": Feature("ArgumentPackage", 0, MANY, True),
            "artifactPackage": Feature("ArtifactPackage", 0, MANY, True),
        },
    ),
    "ArgumentationElement": ("ArtifactElement", {}),
    "ArgumentPackage": (
        "ArgumentationElement",
        {"argumentationElement": Feature("ArgumentationElement", 0, MANY, True)},
    ),
    "ArgumentAsset": ("ArgumentationElement", {}),
    "ArgumentReasoning": ("ArgumentAsset", {}),
    "ArtifactReference": ("ArgumentAsset", {"referencedArtifactElement": Feature("ArtifactElement", 0, MANY)}),
    "Assertion": ("ArgumentAsset", {"assertionDeclaration": Feature("declaration", 1, 1)}),
    "Claim": ("Assertion", {}),
    "AssertedRelationship": (
        "Assertion",
        {
            "isCounter": Feature("truth", 1, 1),
            "source": Feature("ArgumentAsset", 1, MANY),
            "target": Feature("ArgumentAsset", 0, 1),
            "reasoning": Feature("ArgumentReasoning", 0, 1),
        },
    ),
    "AssertedInference": ("AssertedRelationship", {}),
    "AssertedEvidence": ("AssertedRelationship", {}),
    "AssertedContext": ("AssertedRelationship", {}),
}
ABSTRACT = {
    *("Element", "SACMElement", "ModelElement", "UtilityElement", "ArtifactElement"),
    *("ArgumentationElement", "ArgumentAsset", "Assertion", "AssertedRelationship"),
}


def problems(text: str) -> Iterator[str]:
    """Yield the violations of the metamodel in a file."""
    root = ElementTree.fromstring(text)
    kinds: dict[str, str] = {}
    for each in root.iter():
        if (name := each.get(f"{{{XMI}}}id")) is not None:
            if name in kinds:
                yield f"{name} is the id of two elements"
            kinds[name] = _kind(each, "")
    if root.tag != f"{{{NAMESPACES['assuranceCase_']}}}AssuranceCasePackage":
        yield f"the root is {root.tag}"
    yield from _checked(root, "AssuranceCasePackage", kinds)


def _kind(element: ElementTree.Element, declared: str) -> str:
    return (element.get(f"{{{XSI}}}type") or declared).rpartition(":")[2]


def _features(kind: str) -> dict[str, Feature]:
    above, own = CLASSES[kind]
    return {**({} if above is None else _features(above)), **own}


def _is(kind: str, other: str) -> bool:
    above: str | None = kind
    while above is not None and above != other:
        above = CLASSES[above][0]
    return above == other


def _checked(element: ElementTree.Element, kind: str, kinds: Mapping[str, str]) -> Iterator[str]:
    if kind not in CLASSES or kind in ABSTRACT:
        yield f"{kind} is no class of elements"
        return
    features, values = _features(kind), dict[str, list[str]]()
    for name, value in element.attrib.items():
        if name.startswith("{"):
            continue
        feature = features.get(name)
        if feature is None or feature.contained:
            yield f"{kind} has no attribute {name}"
            continue
        values[name] = [value] if feature.type in ("text", "truth", "declaration") else value.split()
        for each in values[name]:
            if feature.type == "truth" and each not in ("true", "false"):
                yield f"{kind}.{name} is {each}"
            if feature.type == "declaration" and each not in DECLARATIONS:
                yield f"{kind}.{name} is {each}"
            if feature.type in CLASSES and not (each in kinds and _is(kinds[each], feature.type)):
                yield f"{kind}.{name} refers to {each}"
    for child in element:
        feature = features.get(child.tag)
        if feature is None or not feature.contained:
            yield f"{kind} contains no {child.tag}"
            continue
        values.setdefault(child.tag, []).append("")
        below = _kind(child, feature.type)
        if below in CLASSES and not _is(below, feature.type):
            yield f"{kind}.{child.tag} is a {below}"
        yield from _checked(child, below, kinds)
    for name, feature in features.items():
        if not feature.lower <= len(values.get(name, [])) <= feature.upper:
            yield f"{kind} has {len(values.get(name, []))} of {name}"
