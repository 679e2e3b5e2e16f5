"""The documents of the checkout as sources of the site, with links that lead to pages of the site."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

#: Folders whose Markdown files are pages, and the files in the top folder that are.
_FOLDERS = ("docs", "plugins", "benchmarks")
_FILES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "AGENTS.md")

#: Folders of the site whose pages are listed on the first page of the folder alone.
_UNLISTED = (("docs", "decisions"), ("gallery",))

_LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^)\s#]*)(#[^)\s]*)?\)")
_FENCE = re.compile(r"(?ms)^(```|~~~).*?^\1\s*$")


@dataclass
class Pages:
    """The pages of the site, and where the files of the checkout are shown on it.

    Attributes:
        checkout: The top folder of the checkout.
        target: The folder of the sources for Sphinx, which has the checkout's folders.
        places: The page that shows a file of the checkout; both relative to their top folders.
    """

    checkout: Path
    target: Path
    places: dict[PurePosixPath, PurePosixPath] = field(default_factory=dict)

    def find(self) -> None:
        """Find all documents: the README is the first page, and the others keep their places."""
        for path in self._documents():
            place = path.with_suffix(".md")
            self.places[path] = PurePosixPath("index.md") if path == PurePosixPath("README.md") else place

    def write(self) -> None:
        """Write each document, with its links and what they lead to."""
        for path in self._documents():
            source = self.checkout / path
            if path.suffix == ".ipynb":
                text = _notebook(source, self.target / path.with_suffix(""))
            else:
                text = source.read_text(encoding="utf-8")
            self.put(self.places[path], self.linked(text, path))

    def put(self, place: PurePosixPath, text: str) -> None:
        """Write a page."""
        page = self.target / place
        page.parent.mkdir(parents=True, exist_ok=True)
        if not self.is_in_navigation(place):
            text = f"---\norphan: true\n---\n\n{text}"
        page.write_text(text, encoding="utf-8")

    def is_in_navigation(self, place: PurePosixPath) -> bool:
        """Return whether the navigation lists a page.

        Decisions and scenarios are listed on one page each instead: a hundred and fifty entries on every page of the
        site would take most of the time of the build.
        """
        return place.stem in ("README", "index") or (
            place.parts[:2] not in _UNLISTED and place.parts[:1] not in _UNLISTED
        )

    def linked(self, text: str, source: PurePosixPath) -> str:
        """Return the text of a document with each relative link as the site needs it.

        A link to a folder leads to its README; one to a file that is no page, to a copy of it.

        Args:
            text: The text, as Markdown.
            source: The document, whose folder links start from.
        """
        parts, end = [], 0
        for fence in _FENCE.finditer(text):
            parts += [self._replaced(text[end : fence.start()], source), fence[0]]
            end = fence.end()
        return "".join([*parts, self._replaced(text[end:], source)])

    def _documents(self) -> Iterator[PurePosixPath]:
        found = [self.checkout / name for name in _FILES]
        for folder in _FOLDERS:
            found += [*self.checkout.glob(f"{folder}/**/*.md"), *self.checkout.glob(f"{folder}/**/*.ipynb")]
        for path in sorted(found):
            relative = path.relative_to(self.checkout)
            if path.is_file() and not any(part.startswith((".", "_")) for part in relative.parts):
                yield PurePosixPath(relative.as_posix())

    def _replaced(self, text: str, source: PurePosixPath) -> str:
        return _LINK.sub(lambda link: self._link(link, source), text)

    def _link(self, link: re.Match[str], source: PurePosixPath) -> str:
        label, target, anchor = link[1], link[2], link[3] or ""
        if not target or "://" in target or target.startswith("mailto:"):
            return link[0]
        found = (self.checkout / source.parent / target).resolve()
        path = PurePosixPath(found.relative_to(self.checkout).as_posix())
        if found.is_dir():
            path = next((each for each in (path, path / "README.md") if each in self.places), path)
        here = self.places.get(source, source).parent
        if path in self.places:
            return f"{label}({_relative(self.places[path], here)}{anchor})"
        if found.is_dir():
            return label[1:-1]
        if not found.exists():
            return link[0]  # made for the site, or for Sphinx to complain about
        copy = self.target / path
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(found, copy)
        return f"{label}({_relative(path, here)})"


def _relative(path: PurePosixPath, folder: PurePosixPath) -> str:
    up = 0
    while not path.is_relative_to(folder):
        folder, up = folder.parent, up + 1
    return "../" * up + path.relative_to(folder).as_posix()


def _notebook(path: Path, folder: Path) -> str:
    """Return a notebook as Markdown: its texts, its code, and what it printed or drew."""
    parts = []
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] != "code":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                folder.mkdir(parents=True, exist_ok=True)
                picture = folder / f"{number}.png"
                picture.write_bytes(base64.b64decode("".join(data["image/png"])))
                parts.append(f"![What the cell draws]({path.stem}/{picture.name})")
                continue
            printed = "".join(output.get("text") or data.get("text/plain", "")).rstrip()
            parts.append(f"```text\n{printed}\n```")
    return "\n\n".join(parts) + "\n"
