"""Assurance cases in the interchange format of SACM 2.3, the Structured Assurance Case Metamodel of the OMG.

The elements, their types and their references are those of the metamodel (Object Management Group, "Structured
Assurance Case Metamodel (SACM), Version 2.3"), written as XMI with the namespaces of the Ecore models that the SACM
revision task force published (github.com/SystemsAssuranceGroup/SACM), which tools on Eclipse read.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from xml.etree import ElementTree

from symaware_cli.evidence.assurance.case_document import CaseDocument

_XMI, _XSI = "http://www.omg.org/XMI", "http://www.w3.org/2001/XMLSchema-instance"
#: The packages of the metamodel by their prefixes.
_PACKAGES = {
    "assuranceCase_": "http://omg.sacm/2.3/assurancecase",
    "argumentation_": "http://omg.sacm/2.3/argumentation",
    "artifact_": "http://omg.sacm/2.3/artifact",
}


def sacm(document: CaseDocument, statuses: Mapping[str, str]) -> bytes:
    """Return the case as XML, without a document type or entities.

    Args:
        document: The case.
        statuses: ``holds``, ``fails`` or ``open`` for each goal, strategy and solution.
    """
    # Types are values of attributes, whose prefixes the serialiser does not see; so all prefixes are written by hand.
    declared_names = {f"xmlns:{prefix}": name for prefix, name in {"xmi": _XMI, "xsi": _XSI, **_PACKAGES}.items()}
    root = ElementTree.Element(
        "assuranceCase_:AssuranceCasePackage", {"xmi:version": "2.0", **declared_names, "gid": "_case"}
    )
    _named(root, document.name)
    package = ElementTree.SubElement(root, "argumentPackage", {"gid": "_argument"})
    _named(package, document.name)
    artifacts = ElementTree.SubElement(root, "artifactPackage", {"gid": "_artifacts"})
    _named(artifacts, "Evidence")

    def element(kind: str, name: str, text: str = "", **attributes: str) -> None:
        place = {"xsi:type": f"argumentation_:{kind}", "xmi:id": name, "gid": name, **attributes}
        made = ElementTree.SubElement(package, "argumentationElement", place)
        _named(made, name)
        if text:
            _described(made, text)

    # Identifiers of a case begin with a letter, so these are none of them.
    numbers = count(1)

    def relation(kind: str, source: str, target: str, *, declared: str = "asserted", **attributes: str) -> None:
        stated = {"assertionDeclaration": declared, "isCounter": "false", "source": source, "target": target}
        element(kind, f"_relation.{next(numbers)}", **stated, **attributes)

    for name, goal in document.goals.items():
        declared = {"holds": "asserted", "fails": "defeated"}.get(statuses.get(name, ""), "needsSupport")
        element("Claim", name, goal.text, assertionDeclaration=declared)
    for name, strategy in document.strategies.items():
        element("ArgumentReasoning", name, strategy.text)
    for section, declared in ((document.assumptions, "assumed"), (document.justifications, "axiomatic")):
        for name, text in section.items():
            element("Claim", name, text, assertionDeclaration=declared)
    for name, text in document.context.items():
        element("ArtifactReference", name, text)
    for name, solution in document.solutions.items():
        artifact = f"_artifact.{name}"
        made = ElementTree.SubElement(artifacts, "artifactElement", {"xsi:type": "artifact_:Artifact"})
        made.set("xmi:id", artifact)
        made.set("gid", artifact)
        _named(made, solution.path)
        element("ArtifactReference", name, solution.shown, referencedArtifactElement=artifact)
    for name, goal in document.goals.items():
        for other in goal.by:
            if other in document.solutions:
                declared = "defeated" if statuses.get(other) == "fails" else "asserted"
                relation("AssertedEvidence", other, name, declared=declared)
            elif other in document.strategies:
                relation("AssertedInference", " ".join(document.strategies[other].by), name, reasoning=other)
            else:
                relation("AssertedInference", other, name)
    for name, argument in document.arguments.items():
        for other in argument.context:
            relation("AssertedContext", other, name)
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _named(element: ElementTree.Element, text: str) -> None:
    ElementTree.SubElement(element, "name", {"lang": "en", "content": _plain(text)})


def _described(element: ElementTree.Element, text: str) -> None:
    described = ElementTree.SubElement(element, "description")
    content = ElementTree.SubElement(described, "content")
    ElementTree.SubElement(content, "value", {"lang": "en", "content": _plain(text)})


def _plain(text: str) -> str:
    """Replace the characters that XML 1.0 cannot contain."""
    return "".join(
        each
        if each in "\t\n\r" or (each >= " " and not "\ud800" <= each <= "\udfff" and each not in "\ufffe\uffff")
        else "\ufffd"
        for each in text
    )
