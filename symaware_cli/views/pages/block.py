"""Blocks of a page: plain data. Each kind has a template that shows it.

A text is shown as it is; nothing in it becomes markup.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias


@dataclass(frozen=True, slots=True)
class Inline:
    """A text with a look.

    Attributes:
        text: The text.
        look: ``code``; ``prose``, in which what stands between backticks is code; or ``verdict``, in the colour of
            the verdict or status that the text is.
    """

    text: str
    look: Literal["code", "prose", "verdict"]

    @property
    def pieces(self) -> Iterator[tuple[bool, str]]:
        """Whether a piece of the text is code, and the piece."""
        if self.look != "prose":
            yield self.look == "code", self.text
            return
        for number, piece in enumerate(re.split("`([^`]*)`", self.text)):
            if piece:
                yield number % 2 == 1, piece


Text: TypeAlias = str | Inline


@dataclass(frozen=True, slots=True)
class FactTable:
    """A table of facts.

    Attributes:
        facts: The value of each fact by its name; those with an empty value are left out.
    """

    template: ClassVar = "blocks/facts.html"
    facts: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class DataTable:
    """A table with a header.

    Attributes:
        header: The names of the columns.
        rows: The cells of each row.
    """

    template: ClassVar = "blocks/table.html"
    header: Sequence[str]
    rows: Sequence[Sequence[Text]]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph.

    Attributes:
        parts: Its texts, one after the other.
        look: ``note`` for a remark, ``error`` for an error.
    """

    template: ClassVar = "blocks/paragraph.html"
    parts: Sequence[Text]
    look: Literal["", "note", "error"] = ""


@dataclass(frozen=True, slots=True)
class CodeLines:
    """Lines of code or of commands.

    Attributes:
        text: The lines.
    """

    template: ClassVar = "blocks/listing.html"
    text: str


@dataclass(frozen=True, slots=True)
class SourceText:
    """A file of YAML or TOML, with its comments, keys and quoted texts in colour.

    Attributes:
        text: The file.
    """

    template: ClassVar = "blocks/source.html"
    text: str

    @property
    def tokens(self) -> Iterator[tuple[str, str]]:
        """The class of each piece of the text, empty for most, and the piece."""
        end = 0
        for found in _TOKENS.finditer(self.text):
            yield "", self.text[end : found.start()]
            yield found.lastgroup or "", found[0]
            end = found.end()
        yield "", self.text[end:]


_TOKENS = re.compile(
    r"""(?P<c>(?:(?<=\s)|^)\#[^\n]*)|(?P<s>"(?:[^"\\\n]|\\.)*"|'[^'\n]*')|(?P<k>[\w./-]+(?=\s*[:=](?:\s|$)))""", re.M
)


@dataclass(frozen=True, slots=True)
class Fold:
    """Blocks that can be folded on the screen; on paper they are shown.

    Attributes:
        title: The text that is shown while it is folded.
        blocks: The blocks.
        is_open: Whether it is unfolded at first.
    """

    template: ClassVar = "blocks/fold.html"
    title: str
    blocks: Sequence[Block]
    is_open: bool = False


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture.

    Attributes:
        content: The file.
        kind: Its type.
        description: A description of the picture, for people who do not see it.
    """

    template: ClassVar = "blocks/picture.html"
    content: bytes
    kind: Literal["svg+xml", "png"]
    description: str

    @property
    def address(self) -> str:
        """The picture as the address of an image, in which no script runs."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.content).decode()}"


@dataclass(frozen=True, slots=True)
class MotionMap:
    """The motion of a run as an animated map.

    Attributes:
        data: What `symaware_cli.views.moving_map` returns.
    """

    template: ClassVar = "blocks/moving_map.html"
    data: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ReplayFrame:
    """The Rerun viewer with a recording.

    Attributes:
        viewer: What `symaware_cli.views.embedded_viewer` returns.
    """

    template: ClassVar = "blocks/viewer.html"
    viewer: Any


@dataclass(frozen=True, slots=True)
class CertificateBlock:
    """A certificate.

    Attributes:
        content: What `symaware_cli.evidence.certificate_page.content` returns.
    """

    template: ClassVar = "blocks/certificate.html"
    content: Mapping[str, Any]


Block: TypeAlias = (
    FactTable
    | DataTable
    | Paragraph
    | CodeLines
    | SourceText
    | Fold
    | Picture
    | MotionMap
    | ReplayFrame
    | CertificateBlock
)
"""Any block."""
