"""Assurance cases in the interchange format of SACM 2.3, the Structured Assurance Case Metamodel of the OMG.

The elements, their types and their references are those of the metamodel (Object Management Group, "Structured
Assurance Case Metamodel (SACM), Version 2.3"), written as XMI. The output was not validated, because the schema was not
available; a tool may need another namespace or another serialisation of attributes.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

from symaware_cli.evidence.assurance.case_document import CaseDocument

_XMI, _XSI = "http://www.omg.org/XMI", "http://www.w3.org/2001/XMLSchema-instance"
_SACM = "http://www.omg.org/spec/SACM/2.3"


def sacm(document: CaseDocument, statuses: Mapping[str, str]) -> bytes:
    """Return the case as XML, without a document type or entities.

    Args:
        document: The case.
        statuses: ``holds``, ``fails`` or ``open`` for each goal, strategy and solution.
    """
    for prefix, name in (("xmi", _XMI), ("xsi", _XSI), ("sacm", _SACM)):
        ElementTree.register_namespace(prefix, name)
    root = ElementTree.Element(f"{{{_SACM}}}AssuranceCasePackage", {f"{{{_XMI}}}version": "2.0", "gid": "case"})
    _named(root, document.name)
    package = ElementTree.SubElement(root, "argumentPackage", {"gid": "argument"})
    _named(package, document.name)
    artifacts = ElementTree.SubElement(root, "artifactPackage", {"gid": "artifacts"})
    _named(artifacts, "Evidence")

    def element(kind: str, name: str, text: str = "", **attributes: str) -> None:
        place = {f"{{{_XSI}}}type": f"sacm:{kind}", f"{{{_XMI}}}id": name, "gid": name, **attributes}
        made = ElementTree.SubElement(package, "argumentationElement", place)
        if text:
            _named(made, name)
            _described(made, text)

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
        artifact = f"{name}-artifact"
        made = ElementTree.SubElement(artifacts, "artifactElement", {f"{{{_XSI}}}type": "sacm:Artifact"})
        made.set(f"{{{_XMI}}}id", artifact)
        made.set("gid", artifact)
        _named(made, solution.path)
        element("ArtifactReference", name, solution.shown, referencedArtifactElement=artifact)
    for name, goal in document.goals.items():
        for other in goal.by:
            relation = f"{name}-{other}"
            if other in document.solutions:
                counter = "true" if statuses.get(other) == "fails" else "false"
                element("AssertedEvidence", relation, source=other, target=name, isCounter=counter)
            elif other in document.strategies:
                sources = " ".join(document.strategies[other].by)
                element("AssertedInference", relation, source=sources, target=name, reasoning=other)
            else:
                element("AssertedInference", relation, source=other, target=name)
    for name, argument in document.arguments.items():
        for other in argument.context:
            element("AssertedContext", f"{name}-in-{other}", source=other, target=name)
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
