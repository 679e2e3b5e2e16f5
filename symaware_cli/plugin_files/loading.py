"""The modules of files of plugins: imported from the bytes that were hashed, and from nowhere else."""

from __future__ import annotations

import builtins
import linecache
import sys
from collections.abc import Mapping, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import decode_source, spec_from_loader
from pathlib import Path, PurePosixPath
from types import CodeType, ModuleType
from typing import Any

from symaware_cli.plugin_files.file_set import FileSet, PluginFileError, is_local, package_of, read_files
from symaware_cli.plugin_files.file_trust import hand_down, handed_down, is_trusted
from symaware_cli.world import name_files_from

_PREFIX = f"{__package__}.of_"


def load_files(files: FileSet) -> Mapping[str, str]:
    """Make files of plugins importable, here and in processes that this one starts; none is imported.

    Args:
        files: The files.

    Returns:
        The name of the module of each file that the scenario names, by its path.

    Raises:
        PluginFileError: Nobody trusts them.
    """
    if not is_trusted(files):
        raise PluginFileError(files.named[0], "untrusted-file", "this code is not trusted")
    hand_down(files)
    name_files_from(str(files.folder))
    _FINDER.sets.setdefault(files.package, _Modules(files))
    return {name: _module(files.package, PurePosixPath(name)) for name in files.named}


def _module(package: str, path: PurePosixPath) -> str:
    """The name of the module of a file."""
    inner = path.parent if path.name == "__init__.py" else path.with_suffix("")
    return ".".join((package, *inner.parts))


class _Modules:
    """The modules of a set of files."""

    def __init__(self, files: FileSet) -> None:
        self._files = files
        self._paths = {_module(files.package, PurePosixPath(name)): name for name in files.contents}
        packages = {files.package}
        for name in self._paths:
            while name != files.package:
                name = name.rpartition(".")[0]
                packages.add(name)
        self._packages = packages | {name for name, path in self._paths.items() if path.endswith("__init__.py")}

    def find(self, name: str) -> ModuleSpec | None:
        """Return the specification of a module; None if it is not of these files."""
        path = self._paths.get(name)
        if path is None and name not in self._packages:
            return None
        origin = None if path is None else str(self._files.folder / path)
        spec = spec_from_loader(name, _FileLoader(self, name), origin=origin, is_package=name in self._packages)
        assert spec is not None
        if origin is not None:
            spec.has_location = True  # sets `__file__`
        return spec

    def code(self, name: str) -> CodeType | None:
        """Compile a module; None for a folder without code."""
        path = self._paths.get(name)
        if path is None:
            return None
        content, file = self._files.contents[path], str(self._files.folder / path)
        # Tracebacks show the lines that are executed, whatever becomes of the file.
        lines = decode_source(content).splitlines(keepends=True)
        linecache.cache[file] = (len(content), None, lines, file)
        return compile(content, file, "exec", dont_inherit=True)

    def root(self, name: str) -> str:
        """The package from which the imports of a module begin: that of the scenario's file that needs it."""
        path = PurePosixPath(self._paths[name])
        roots = [PurePosixPath(each).parent for each in self._files.named]
        nearest = max((each for each in roots if path.is_relative_to(each)), key=lambda each: len(each.parts))
        return ".".join((self._files.package, *nearest.parts))

    def has(self, name: str) -> bool:
        """Whether there is a module or a package."""
        return name in self._paths or name in self._packages

    def is_other(self, root: str, name: str) -> bool:
        """Whether a module that is not of these files is in their folder."""
        inner = root.removeprefix(self._files.package).strip(".").split(".")
        return is_local(self._files.folder.joinpath(*filter(None, inner)), name)


class _FileLoader(Loader):
    """Executes one module."""

    def __init__(self, modules: _Modules, name: str) -> None:
        self._modules, self._name = modules, name

    def create_module(self, spec: ModuleSpec) -> None:
        """Let Python create the module."""

    def exec_module(self, module: ModuleType) -> None:
        """Execute the bytes that were hashed, with imports that find the other files."""
        code = self._modules.code(self._name)
        if code is None:
            return
        vars(module)["__builtins__"] = {**vars(builtins), "__import__": self._import}
        exec(code, vars(module))

    def _import(
        self,
        name: str,
        globals: Mapping[str, Any] | None = None,  # noqa: A002 # the names of Python's own function
        locals: Mapping[str, Any] | None = None,  # noqa: A002
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        first = name.partition(".")[0]
        root = self._modules.root(self._name)
        if level or not self._modules.has(f"{root}.{first}"):
            if not level and self._modules.is_other(root, first):
                raise ImportError(f"`{first}` is in the scenario's folder, and was not there when its files were read")
            return builtins.__import__(name, globals, locals, fromlist or (), level)
        inner = {"__name__": root, "__package__": root, "__path__": []}
        found = builtins.__import__(f"{root}.{name}", inner, locals, fromlist or ("",), 0)
        return found if fromlist else sys.modules[f"{root}.{first}"]


class _Finder(MetaPathFinder):
    """Finds the modules of all sets of files that this process has loaded or inherited."""

    def __init__(self) -> None:
        self.sets: dict[str, _Modules] = {}

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if not fullname.startswith(_PREFIX):
            return None
        package = ".".join(fullname.split(".")[: _PREFIX.count(".") + 1])
        if package not in self.sets:
            files = _handed_down(package)
            if files is None:
                return None
            name_files_from(str(files.folder))
            self.sets[package] = _Modules(files)
        return self.sets[package].find(fullname)


def _handed_down(package: str) -> FileSet | None:
    """Read the files of a package that the process that started this one has loaded."""
    for each in handed_down():
        if package_of(each["files"]) == package:
            files = read_files(Path(each["folder"]), each["named"])
            if files.package != package:
                raise ImportError(f"files of plugins in {files.folder} have changed since the run began")
            return files
    return None


_FINDER = _Finder()
sys.meta_path.append(_FINDER)
