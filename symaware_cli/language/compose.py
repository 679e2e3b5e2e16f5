"""Composes a scenario file into one resolved document: `extends`, `--set` and `parameters`, in this order.

All steps work on trees of nodes with positions, so that the file (or the `--set`) of each value is known.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as FilePath
from pathlib import PurePath, PurePosixPath, PureWindowsPath
from typing import Any, Self

from symaware_cli.assets.asset import is_packaged
from symaware_cli.language.assignment import Assignment, assigned
from symaware_cli.language.changes import Changes, assignments
from symaware_cli.language.group_templates import Likeness, expanded, is_about_templates
from symaware_cli.language.merge_patch import merge
from symaware_cli.language.parameter_references import substitute
from symaware_cli.language.problem import Problem, ScenarioError, TextSpan, dotted, quoted
from symaware_cli.language.source import MappingEntry, Path, Source, SourceNode
from symaware_cli.language.source_parser import SUFFIXES, read
from symaware_cli.world import nearest_file

MAX_EXTENDS_DEPTH = 16
# Bounds the work if several files extend the same base.
MAX_EXTENDS = 64

# Codes of problems that affect only a single value of a document.
_SINGLE_VALUE = {
    "bad-character",
    "bad-reference",
    "cyclic-alias",
    "cyclic-parameter",
    "date-not-allowed",
    "duplicate-key",
    "key-not-text",
    "not-finite",
    "tag-not-allowed",
    "too-large-number",
    "undefined-alias",
    "undefined-parameter",
    "wrong-tag",
}


class Composition:
    """A resolved document with the position of each value.

    Attributes:
        name: The top file's name as the user typed it.
        data: The document as plain data: bases merged, changes applied, references replaced; without `extends`.
        files: Each file as written, keyed by its path relative to the top file's folder; the top file comes first.
    """

    def __init__(
        self,
        name: str,
        root: SourceNode,
        files: dict[str, bytes],
        sources: dict[str, Source],
        likenesses: Mapping[str, Likeness] | None = None,
    ) -> None:
        self._likenesses = likenesses or {}
        self.name = name
        self.data: dict[str, Any] = root.plain()
        self.files = files
        self._root = root
        self._sources = sources

    def copy(self) -> Self:
        """Returns the same document with a copy of its data, which may be changed."""
        return type(self)(self.name, self._root, self.files, self._sources, self._likenesses)

    def span(self, path: Path, key: bool = False) -> TextSpan:
        """Returns the position of the value (or the key) at a path, or of its nearest existing ancestor."""
        return self._root.nearest_span(path, key=key)

    def has(self, path: Path) -> bool:
        """Returns whether a file or an override has a value at a path."""
        return self._root.descendant(path) is not None

    def line_text(self, span: TextSpan) -> str | None:
        """Returns the whole line of a span."""
        source = self._sources.get(span.file)
        return source.line_text(span.line) if source else None

    def problem(
        self,
        code: str,
        message: str,
        path: Path,
        *,
        key: bool = False,
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> Problem:
        """Returns a problem with the value (or the key) at a path, including its position."""
        span = self.span(path, key)
        line = self.line_text(span)
        return Problem(code, message, span, dotted(path), expected, suggestion, line, self._users(path, span))

    def _users(self, path: Path, span: TextSpan) -> tuple[str, ...]:
        """Returns the group that has a value from a template, and the line with `like`; empty for other values."""
        likeness = self._likenesses.get(str(path[1])) if path[:1] == ("agents",) and len(path) > 2 else None
        if likeness is None or likeness.own.descendant(path[2:]) is not None or span.file.startswith("--"):
            return ()
        if self._root.descendant(path) is None and likeness.own.span == span:
            return ()
        return (f"{path[1]} (line {likeness.line}, like {' and '.join(likeness.names)})",)


class CompositionError(ScenarioError):
    """All problems so far concern single values, so that the rest of the document can be checked in the same pass.

    Attributes:
        partial: The document without them; an invalid value is null in it, or its text as written.
    """

    def __init__(self, problems: Iterable[Problem], partial: Composition) -> None:
        super().__init__(problems)
        self.partial = partial


#: The sections of a file of specifications.
_STATEMENTS = ("specifications", "regions")


def compose(
    path: FilePath,
    changes: Changes | None = None,
    name: str | None = None,
    statements: FilePath | None = None,
) -> Composition:
    """Reads a scenario and resolves it.

    Files are merged according to JSON Merge Patch (RFC 7396): mappings merge, other values replace, and null removes
    an inherited key. A null without an inherited key remains.

    Args:
        path: The scenario file.
        changes: Values that replace those of the file, as for `--set`.
        name: The name of the file in messages; by default its path.
        statements: A file of specifications, with the regions that they need, to use in place of the scenario's.

    Raises:
        ScenarioError: Contains every problem found; a `CompositionError` if the document can be checked further.
    """
    files = _Files(path, str(path) if name is None else name)
    root = files.compose_top()
    changed = assignments(changes)
    sources = files.sources | {each.source.name: each.source.copy() for each in changed}
    stated = None if statements is None else read(statements, str(statements))
    if stated is not None:
        sources[stated.name] = stated
        _require_statements(stated)
    # Changes have no tree, so this concerns files only.
    if root is None or not _is_whole(sources) or any(each.root is None for each in files.sources.values()):
        raise ScenarioError(_problems(sources))
    if stated is not None:
        if stated.root is None:
            raise ScenarioError(_problems(sources))
        root = _with_statements(root, stated.root)
    return _resolved(files.name, root, changed, sources, files.raw, files.folders)


def compose_content(
    root: SourceNode, source: Source, files: dict[str, bytes], changes: Changes | None = None
) -> Composition:
    """Resolves a scenario that a program wrote as a mapping.

    Args:
        root: The document; all of its values are at the place in the program.
        source: The text of the program.
        files: The document as a file.
        changes: Values that replace those of the document.

    Raises:
        ScenarioError: Contains every problem found; a `CompositionError` if the document can be checked further.
    """
    changed = assignments(changes)
    sources = {source.name: source} | {each.source.name: each.source.copy() for each in changed}
    return _resolved(source.name, root, changed, sources, files, {})


def _resolved(
    name: str,
    root: SourceNode,
    changed: Sequence[Assignment],
    sources: dict[str, Source],
    raw: dict[str, bytes],
    folders: Mapping[str, str],
) -> Composition:
    root = assigned(root, [each for each in changed if is_about_templates(each.path)], sources)
    root, likenesses = expanded(root, sources)
    root = assigned(root, [each for each in changed if not is_about_templates(each.path)], sources)
    root = substitute(root, sources)
    if any(folders.values()):
        root = _with_relative_files(root, folders)
    problems = _problems(sources)
    if not _is_whole(sources):
        raise ScenarioError(problems)
    composition = Composition(name, root, raw, sources, likenesses)
    if problems:
        raise CompositionError(problems, composition)
    return composition


def _with_relative_files(root: SourceNode, folders: Mapping[str, str], around: tuple[str, ...] = ()) -> SourceNode:
    """Returns a document in which paths of asset files are relative to the top file's folder."""
    if isinstance(root.value, dict):
        entries = {
            key: MappingEntry(entry.key, _with_relative_files(entry.node, folders, (*around, key)))
            for key, entry in root.value.items()
        }
        changed = any(entry.node is not root.value[key].node for key, entry in entries.items())
        for listed in ("assets", "plugins") if not around else ():
            if listed in entries:
                entries[listed] = MappingEntry(entries[listed].key, _relative_to_top(entries[listed].node, folders))
                changed = True
        named = entries.get("file")
        is_file = around[-2:-1] in (("shape",), ("with",)) or around[-3:-2] == ("own",)
        folder = folders.get(named.node.span.file) if named and is_file else None
        if named and folder and isinstance(named.node.value, str) and not is_packaged(named.node.value):
            beside = SourceNode(str(PurePosixPath(folder, named.node.value)), named.node.span)
            entries, changed = entries | {"file": MappingEntry(named.key, beside)}, True
        return SourceNode(entries, root.span) if changed else root
    return root


def _relative_to_top(listed: SourceNode, folders: Mapping[str, str]) -> SourceNode:
    """Returns a list of paths, relative to the top file's folder."""
    if not isinstance(listed.value, list):
        return listed
    found = [
        SourceNode(str(PurePosixPath(folders.get(each.span.file, ""), each.value)), each.span)
        if isinstance(each.value, str)
        else each
        for each in listed.value
    ]
    return SourceNode(found, listed.span)


def _require_statements(source: Source) -> None:
    """Reports keys of a file of specifications other than `specifications` and `regions`."""
    if source.root is None:
        return
    if not isinstance(source.root.value, dict):
        source.report("wrong-type", "this is no mapping", source.root.span, (), expected="`specifications`")
        return
    for key, entry in source.root.value.items():
        if key not in _STATEMENTS:
            message, expected = f"{quoted(key)} does not belong here", " or ".join(map(quoted, _STATEMENTS))
            source.report("unknown-key", message, entry.key, (key,), expected=expected)


def _with_statements(root: SourceNode, statements: SourceNode) -> SourceNode:
    """Returns a document with the specifications replaced and further regions added."""
    if isinstance(root.value, dict) and isinstance(statements.value, dict) and "specifications" in statements.value:
        root = SourceNode({key: entry for key, entry in root.value.items() if key != "specifications"}, root.span)
    return merge(root, statements)


def _problems(sources: Mapping[str, Source]) -> list[Problem]:
    return [problem for source in sources.values() for problem in source.problems]


def _is_whole(sources: Mapping[str, Source]) -> bool:
    """Returns whether all problems concern single values."""
    return all(problem.code in _SINGLE_VALUE for problem in _problems(sources))


class _Files:
    """The files of one scenario, each read once."""

    def __init__(self, path: FilePath, name: str) -> None:
        self.name = name
        self.sources: dict[str, Source] = {}
        self.raw: dict[str, bytes] = {}
        #: The folder of each file relative to that of the top file, by the name of its source.
        self.folders: dict[str, str] = {}
        self._path = path
        self._folder = os.path.realpath(path.parent)
        # Each file with its bases merged in, by its path relative to the folder.
        self._composed: dict[str, SourceNode | None] = {}
        # The files that are being composed, the top file first.
        self._open: list[str] = []
        self._extends = 0

    def compose_top(self) -> SourceNode | None:
        source = read(self._path, self.name)
        return self._compose(self._path.name, source)

    def _compose(self, relative: str, source: Source) -> SourceNode | None:
        """Returns a file with its bases merged in, or `None` if it could not be parsed."""
        self.sources[source.name] = source
        self.folders[source.name] = PurePath(relative).parent.as_posix().removeprefix(".")
        self.raw[PurePath(relative).as_posix()] = source.raw
        root = source.root
        if root is None or not isinstance(root.value, dict):
            return None
        self._open.append(relative)
        bases = [self._base(source, value, path) for value, path in _extended(source, root)]
        self._open.pop()
        own = SourceNode({key: entry for key, entry in root.value.items() if key != "extends"}, root.span)
        composed: SourceNode | None = None
        for layer in [base for base in bases if base is not None] + [own]:
            composed = layer if composed is None else merge(composed, layer)
        self._composed[relative] = composed
        return composed

    def _base(self, source: Source, value: SourceNode, path: Path) -> SourceNode | None:
        """Returns a file named under `extends`, composed; reports a problem at its name if that fails."""
        written = str(value.value)
        relative = os.path.normpath(os.path.join(os.path.dirname(self._open[-1]), written))
        real = os.path.realpath(os.path.join(self._folder, relative))
        absolute = PurePosixPath(written).is_absolute() or PureWindowsPath(written).anchor
        if absolute or PurePath(relative).parts[:1] == ("..",) or not FilePath(real).is_relative_to(self._folder):
            message = f"{quoted(written)} is outside the scenario's folder"
            source.report("outside-folder", message, value.span, path, expected="a file in the same folder or below")
            return None
        if relative in self._open:
            cycle = " -> ".join([*self._open[self._open.index(relative) :], relative])
            source.report("cyclic-extends", f"a file cannot extend itself: {cycle}", value.span, path)
            return None
        self._extends += 1
        if len(self._open) > MAX_EXTENDS_DEPTH or self._extends > MAX_EXTENDS:
            deep = f"more than {MAX_EXTENDS_DEPTH} files deep"
            many = f"more than {MAX_EXTENDS} files"
            message = f"`extends` goes {deep if len(self._open) > MAX_EXTENDS_DEPTH else 'through ' + many}"
            source.report("too-deep", message, value.span, path)
            return None
        if relative in self._composed:
            return self._composed[relative]
        file = FilePath(self._folder, relative)
        base = read(file, os.path.join(os.path.dirname(self.name), relative))
        if base.problems and all(problem.span is None for problem in base.problems):
            # The file itself could not be read, so the problem is reported at its name.
            for problem in base.problems:
                source.report(
                    problem.code,
                    problem.message,
                    value.span,
                    path,
                    expected=problem.expected,
                    suggestion=_nearest_base(file, written) if problem.code == "missing-file" else problem.suggestion,
                )
            return None
        return self._compose(relative, base)


def _nearest_base(file: FilePath, written: str) -> str | None:
    """Returns the path of the base that was probably meant, in the form of the missing one."""
    found = nearest_file(file, SUFFIXES)
    return (PurePosixPath(written).parent / found).as_posix() if found else None


def _extended(source: Source, root: SourceNode) -> list[tuple[SourceNode, Path]]:
    """Returns the file names under `extends`, each with its path in the document."""
    assert isinstance(root.value, dict)
    if "extends" not in root.value:
        return []
    value = root.value["extends"].node
    named: list[tuple[SourceNode, Path]]
    if isinstance(value.value, list):
        named = [(child, ("extends", index)) for index, child in enumerate(value.value)]
    else:
        named = [(value, ("extends",))]
    good = []
    for node, path in named:
        if isinstance(node.value, str) and node.value.strip():
            good.append((node, path))
        else:
            source.report(
                "wrong-type", "`extends` names a file", node.span, path, expected="a file name or a list of them"
            )
    return good
