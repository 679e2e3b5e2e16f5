"""XML of untrusted files: elements with their places, without document types, and within bounds."""

from __future__ import annotations

from typing import NoReturn
from xml.etree.ElementTree import Element
from xml.parsers import expat

from symaware_cli.assets.asset_error import AssetError

#: The greatest nesting of elements, and the greatest number of elements in a file.
_DEEPEST = 100
_MOST_ELEMENTS = 200_000


class XmlElement(Element):
    """An element with its place in the file.

    Attributes:
        line: The line of its start, from 1.
        column: The column of its start, from 1.
        file: The file, if another one includes it.
    """

    line: int
    column: int
    file: str = ""

    def children(self, *tags: str) -> list[XmlElement]:
        """Return the elements in this one, in their order; of all tags, or of some."""
        return [each for each in self if isinstance(each, XmlElement) and (not tags or each.tag in tags)]

    def refuse(self, message: str) -> NoReturn:
        """Refuse the file for a problem with this element.

        Raises:
            AssetError: Always.
        """
        raise AssetError(message, self.line, self.column, self.file)


class _TreeReader:
    """Receives what the parser finds, and builds the elements."""

    def __init__(self) -> None:
        self.root: XmlElement | None = None
        self._open: list[XmlElement] = []
        self._texts: list[str] = []
        self._count = 0
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._texts.append
        self._parser.StartDoctypeDeclHandler = self._doctype

    def parse(self, data: bytes) -> XmlElement:
        self._parser.Parse(data, True)
        assert self.root is not None  # a document without an element is not well-formed
        return self.root

    def _place(self) -> tuple[int, int]:
        return self._parser.CurrentLineNumber, self._parser.CurrentColumnNumber + 1

    def _doctype(self, *_: object) -> None:
        # Entities of a document type could make a small file fill the memory, or name other files.
        raise AssetError("it declares a document type (DOCTYPE), which no robot, mesh or road needs", *self._place())

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > _MOST_ELEMENTS:
            raise AssetError(f"it has more than {_MOST_ELEMENTS:,} elements", *self._place())
        if len(self._open) >= _DEEPEST:
            raise AssetError(f"its elements are nested more than {_DEEPEST} deep", *self._place())
        element = XmlElement(tag, attributes)
        element.line, element.column = self._place()
        if self._open:
            self._open[-1].append(element)
        else:
            self.root = element
        self._open.append(element)
        self._texts.clear()

    def _end(self, tag: str) -> None:
        element = self._open.pop()
        # For an element with children, only text after the last child is kept, which no reader uses.
        element.text = "".join(self._texts)
        self._texts.clear()


def xml_tree(data: bytes) -> XmlElement:
    """Parse XML without a document type declaration; nothing but the data is read.

    Raises:
        AssetError: The data is no such XML, or exceeds the bounds.
    """
    try:
        return _TreeReader().parse(data)
    except expat.ExpatError as error:
        raise AssetError(f"it is no XML: {expat.ErrorString(error.code)}", error.lineno, error.offset + 1) from error
    except (UnicodeDecodeError, LookupError, ValueError) as error:
        if isinstance(error, AssetError):
            raise
        raise AssetError(f"it is no XML: {error}") from error
