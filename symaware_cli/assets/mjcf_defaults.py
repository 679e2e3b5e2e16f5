"""Defaults of MJCF: attributes that elements have by their class, if they do not have them themselves."""

from __future__ import annotations

from collections.abc import Iterable

from symaware_cli.assets.xml_tree import XmlElement

#: The kinds of actuators, which share their defaults.
ACTUATORS = {"general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"}


class MjcfDefaults:
    """The classes of defaults of a file."""

    def __init__(self, sections: Iterable[XmlElement]) -> None:
        """Read the outermost sections of defaults.

        Raises:
            AssetError: A class has no name, or exists twice.
        """
        self._classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for section in sections:
            self._read(section, None)

    def _read(self, section: XmlElement, outer: str | None) -> None:
        name = section.get("class") or ("main" if outer is None else "")
        if not name or (outer is not None and name in self._classes):
            section.refuse(f"the class `{name}` of defaults exists twice" if name else "a nested `default` has a class")
        inherited = self._classes["main" if outer is None else outer]
        own = self._classes[name] = {tag: dict(given) for tag, given in inherited.items()}
        for each in section.children():
            if each.tag != "default":
                tag = "actuator" if each.tag in ACTUATORS else each.tag
                own[tag] = own.get(tag, {}) | each.attrib
        for each in section.children("default"):
            self._read(each, name)

    def attributes(self, element: XmlElement, around: str) -> dict[str, str]:
        """Return the attributes of an element, with defaults for those that it does not have.

        Args:
            element: The element.
            around: The class of defaults of the elements around it, which counts if it has none itself.

        Raises:
            AssetError: The element has a class that does not exist.
        """
        name = element.get("class") or around
        if name not in self._classes:
            element.refuse(f"there are no defaults of the class `{name}`")
        tag = "actuator" if element.tag in ACTUATORS else str(element.tag)
        return self._classes[name].get(tag, {}) | element.attrib


def bare(element: XmlElement) -> XmlElement:
    """Return an element without its children and its material, at the same place."""
    copied = XmlElement(element.tag, {key: own for key, own in element.attrib.items() if key != "material"})
    copied.line, copied.column, copied.file = element.line, element.column, element.file
    return copied


def kept_defaults(section: XmlElement) -> XmlElement:
    """Return defaults without those of visual shapes and actuators."""
    kept = bare(section)
    for each in section.children():
        if each.tag == "default":
            kept.append(kept_defaults(each))
        elif each.tag in ("joint", "geom", "site", "mesh", "equality"):
            kept.append(bare(each))
    return kept
