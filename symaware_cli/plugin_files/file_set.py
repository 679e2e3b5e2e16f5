"""The files that a scenario names as plugins, with those that they import: read once, and hashed and run as read."""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path, PurePosixPath, PureWindowsPath

#: The largest file [bytes], and the greatest number of files: those that a scenario names, and those they import.
MAX_SIZE = 1 << 20
MAX_FILES = 200


class PluginFileError(Exception):
    """A file of plugins cannot be used.

    Attributes:
        name: Its name in the scenario.
        code: A stable identifier for tools.
        expected: A description of valid content.
    """

    def __init__(self, name: str, code: str, message: str, expected: str | None = None) -> None:
        super().__init__(message)
        self.name = name
        self.code = code
        self.expected = expected


@dataclass(frozen=True)
class FileSet:
    """Files of plugins with those that they import from the same folder.

    Attributes:
        folder: The folder of the scenario.
        named: The files that the scenario names, relative to the folder.
        contents: The content of each file, by its path relative to the folder, sorted.
    """

    folder: Path
    named: tuple[str, ...]
    contents: Mapping[str, bytes]

    @cached_property
    def digests(self) -> Mapping[str, str]:
        """The SHA-256 of each file in hexadecimal digits."""
        return {name: hashlib.sha256(content).hexdigest() for name, content in self.contents.items()}

    @cached_property
    def package(self) -> str:
        """The package that their modules are in, whose name depends on the content of all."""
        return package_of(self.digests)


def package_of(digests: Mapping[str, str]) -> str:
    """Return the name of the package of some files by the digest of each."""
    told = "\n".join(f"{digest} {name}" for name, digest in sorted(digests.items()))
    return f"{__package__}.of_{hashlib.sha256(told.encode()).hexdigest()[:16]}"


def read_files(folder: Path, names: Sequence[str]) -> FileSet:
    """Read files of plugins and the files of the folder that they import; nothing is executed.

    Args:
        folder: The folder of the scenario.
        names: Their names, relative to the folder.

    Raises:
        PluginFileError: One cannot be used.
    """
    home = folder.resolve()
    contents: dict[str, bytes] = {}
    for number, name in enumerate(names):
        _check_name(name)
        if any(PurePosixPath(name).stem == PurePosixPath(other).stem for other in names[:number]):
            raise PluginFileError(name, "duplicate-key", f"two files are called `{PurePosixPath(name).stem}`")
        waiting = [PurePosixPath(name)]
        while waiting:
            path = waiting.pop()
            if str(path) in contents:
                continue
            if len(contents) >= MAX_FILES:
                raise PluginFileError(name, "too-large", f"`{name}` imports more than {MAX_FILES} files of the folder")
            content = contents[str(path)] = _content(home, path, name)
            waiting += _imported(home, PurePosixPath(name).parent, path, content)
    return FileSet(home, tuple(str(PurePosixPath(name)) for name in names), dict(sorted(contents.items())))


def _check_name(name: str) -> None:
    path = PurePosixPath(name)
    if "\0" in name or path.is_absolute() or ".." in path.parts or PureWindowsPath(name).anchor or "\\" in name:
        raise PluginFileError(
            name, "outside-folder", f"`{name}` is outside the scenario's folder", "a file in the same folder or below"
        )
    if path.suffix != ".py" or not all(each.isidentifier() for each in (*path.parent.parts, path.stem)):
        raise PluginFileError(name, "wrong-type", f"`{name}` is no file of Python", "a name such as `controllers.py`")


def _content(home: Path, path: PurePosixPath, name: str) -> bytes:
    """Read a file; `name` is that of the scenario's file that needs it."""
    file = home / path
    try:
        real = file.resolve(strict=True)
        if not real.is_relative_to(home):
            raise PluginFileError(name, "outside-folder", f"`{path}` is a link out of the scenario's folder")
        if not real.is_file():
            raise PluginFileError(name, "missing-file", f"`{path}` is no file")
        with real.open("rb") as opened:
            content = opened.read(MAX_SIZE + 1)
    except FileNotFoundError as error:
        raise PluginFileError(name, "missing-file", f"there is no file `{path}` beside the scenario") from error
    except (OSError, RuntimeError) as error:  # such as a cycle of links
        said = getattr(error, "strerror", None) or str(error)
        raise PluginFileError(name, "missing-file", f"cannot read `{path}`: {said.lower()}") from error
    if len(content) > MAX_SIZE:
        raise PluginFileError(name, "too-large", f"`{path}` has more than {MAX_SIZE:,} bytes")
    return content


def _imported(home: Path, root: PurePosixPath, path: PurePosixPath, content: bytes) -> Iterator[PurePosixPath]:
    """Yield the files of the folder that a file imports, whether at its beginning or in a function."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return  # it is told when the file is imported
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _modules(home, root, alias.name.split("."))
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".") if node.module else []
            if node.level:
                package = path.parents[node.level - 1] if node.level <= len(path.parents) else None
                if package is None or not package.is_relative_to(root):
                    continue
                module = [*package.relative_to(root).parts, *module]
            for alias in node.names:
                yield from _modules(home, root, [*module, alias.name])


def _modules(home: Path, root: PurePosixPath, parts: Sequence[str]) -> Iterator[PurePosixPath]:
    """Yield the files of a module of the folder and of the packages that contain it."""
    if not parts or not is_local(home / root, parts[0]):
        return
    for count in range(1, len(parts) + 1):
        inner = root.joinpath(*parts[:count])
        for file in (inner / "__init__.py", inner.parent / f"{inner.name}.py"):
            if (home / file).is_file():
                yield file
                break


def is_local(folder: Path, name: str) -> bool:
    """Return whether a module or package is in a folder, and neither of Python nor of an installed distribution."""
    if name in sys.stdlib_module_names or not name.isidentifier():
        return False
    if not (folder / f"{name}.py").is_file() and not (folder / name).is_dir():
        return False
    return name != __name__.partition(".")[0] and name not in _installed(tuple(sys.path))


@cache
def _installed(path: tuple[str, ...]) -> Set[str]:
    """The modules and packages of installed distributions; found once, as it takes a fifth of a second."""
    from importlib import metadata

    return metadata.packages_distributions().keys()
