"""Inclusions of MJCF: the contents of other files in the place of the elements that name them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.mesh_file import content
from symaware_cli.assets.xml_tree import XmlElement, xml_tree

#: The greatest size of all files together [bytes], and the most files.
LARGEST_FILES = 16 << 20
_MOST_FILES = 100


class MjcfInclusions:
    """Reads the files that a file includes.

    Attributes:
        paths: The files, by their paths relative to the including file.
    """

    def __init__(self, find: Callable[[XmlElement, str], Path] | None, left: int) -> None:
        """Prepare to read files.

        Args:
            find: Returns the path of a file that an element includes; None if all inclusions are refused.
            left: The greatest size of all included files together [bytes].
        """
        self.paths: dict[str, Path] = {}
        self._find, self._left = find, left

    def resolve(self, element: XmlElement, within: tuple[str, ...] = ()) -> None:
        """Put the contents of included files in the place of the elements that name them.

        Args:
            element: The element, with all that it contains.
            within: The files that the element is included by, from the outermost on.

        Raises:
            AssetError: A file cannot be included.
        """
        for place, child in reversed(list(enumerate(element))):
            assert isinstance(child, XmlElement)
            if child.tag != "include":
                self.resolve(child, within)
                continue
            name = child.get("file") or ""
            if not name.strip():
                child.refuse("an `include` has a `file`")
            if name in within:
                child.refuse(f"`{name}` includes itself")
            if self._find is None or len(self.paths) >= _MOST_FILES:
                child.refuse(f"it includes more than {_MOST_FILES} files" if self._find else "it includes another file")
            path = self._find(child, name)
            self.paths[name] = path
            try:
                data = content(path, max(self._left, 0))
                self._left -= len(data)
                inner = xml_tree(data)
            except AssetError as error:
                child.refuse(f"it includes {error.located(name)}")
            for each in inner.iter():
                assert isinstance(each, XmlElement)
                each.file = name
            self.resolve(inner, (*within, name))
            element[place : place + 1] = list(inner)
