"""Explains YAML syntax errors: translates the errors of PyYAML's parser into plain messages with positions."""

import re

import yaml

from symaware_cli.language.problem import TextSpan
from symaware_cli.language.source import Source

# (pattern over the parser's message, code, message); the first that matches is used.
_WORDS: tuple[tuple[str, str, str], ...] = (
    (r"unexpected end of stream", "unclosed", "the text that starts here is never closed with a quote"),
    (
        r"unexpected document (indicator|separator)",
        "unclosed",
        "the text that starts here is never closed with a quote",
    ),
    (r"unknown escape character", "bad-escape", "this is not an escape that a double-quoted text knows; write `\\\\`"),
    (
        r"hexdecimal|escape sequence of \d|[Uu]nicode character escape|invalid Unicode",
        "bad-escape",
        "this escape is not a valid character",
    ),
    (r"tab character", "tab", "a tab cannot be used for indentation; use spaces"),
    (
        r"indentation indicator|expected comment or (a )?line break|chomping",
        "syntax",
        "a text block starts with `|` or `>` alone on the line",
    ),
    (
        r"block sequence entries are not allowed|sequence entries are not allowed",
        "bad-indentation",
        "a list item `- ` cannot start here; put it on a line of its own",
    ),
    (r"mapping keys are not allowed", "bad-indentation", "a key cannot start here; put it on a line of its own"),
    (
        r"undefined tag handle|tag|directive|%YAML|incompatible YAML",
        "syntax",
        "tags and directives have no place in a scenario",
    ),
    (
        r"alphabetic or numeric",
        "syntax",
        "the name of an anchor or alias (after `&` or `*`) is made of letters and digits",
    ),
    (r"document start", "bad-indentation", "this cannot stand here; the document ended on the line before"),
    (r"node content", "syntax", "a value is expected here"),
    (r"could not find expected ':'", "syntax", "a `:` is missing after this key"),
    (r"unexpected ':'", "syntax", "`:` cannot stand here; put the text in quotes"),
    (r"simple key", "syntax", "a `:` is missing after this key"),
)


def report_syntax_error(source: Source, error: yaml.YAMLError) -> None:
    """Adds a problem for a syntax error, at the position where it should be corrected."""
    mark = getattr(error, "problem_mark", None)
    context_mark = getattr(error, "context_mark", None)
    reason = str(getattr(error, "problem", None) or "")
    if mark is None:
        source.report("syntax", f"this is not valid YAML: {reason or type(error).__name__}", None)
        return
    here = _Position(source, mark)
    if re.search(r"mapping values are not allowed|expected key|<block end>|could not find expected ':'", reason):
        colon = _colon_without_space(source, here)
        if colon is not None:
            source.report("syntax", "a space is missing after this `:`", colon)
            return
    if "cannot start any token" in reason:
        _report_stray_character(source, here)
    elif context_mark is not None and ("',' or ']'" in reason or "',' or '}'" in reason):
        _report_bracket(source, here, _Position(source, context_mark), "]" if "]" in reason else "}")
    elif "mapping values are not allowed" in reason:
        _report_second_colon(source, here)
    elif context_mark is not None and (
        "expected key" in reason or "'-' indicator" in reason or "<block end>" in reason
    ):
        _report_misfit(source, here, _Position(source, context_mark))
    else:
        _report_by_words(source, reason, here, _Position(source, context_mark) if context_mark is not None else None)


def _colon_without_space(source: Source, here: "_Position") -> TextSpan | None:
    """Find the colon that joins a key and its value to one text, so that the following line does not fit."""
    above = next((line for line in range(here.line - 1, 0, -1) if (source.line_text(line) or "").strip()), here.line)
    for line in (here.line, above):
        joined = re.match(r" *[A-Za-z_][\w.-]*:(?=[^\s:/])", source.line_text(line) or "")
        if joined:
            return TextSpan(source.name, line, joined.end(), joined.end() + 1)
    return None


class _Position:
    """A position in the text, with the text around it."""

    def __init__(self, source: Source, mark: yaml.Mark) -> None:
        self.line = mark.line + 1
        self.column = mark.column + 1
        self.text = source.line_text(self.line) or ""
        self.span = TextSpan(source.name, self.line, self.column, self.column + 1)
        self.before = self.text[: mark.column]
        self.character = self.text[mark.column : mark.column + 1]
        self.is_end = self.line >= len(source.lines) and not self.text[mark.column :].strip()


def _report_stray_character(source: Source, here: _Position) -> None:
    if here.character == "\t":
        source.report("tab", "a tab cannot be used for indentation; use spaces", here.span)
    elif here.character in ("@", "`", "%"):
        source.report("syntax", f"a text that starts with {here.character!r} must be in quotes", here.span)
    else:
        source.report("syntax", f"{here.character!r} cannot stand here", here.span)


def _report_bracket(source: Source, here: _Position, opening: _Position, bracket: str) -> None:
    kind = "list" if bracket == "]" else "mapping"
    if here.is_end:
        source.report("unclosed", f"this {kind} is never closed with `{bracket}`", opening.span)
        return
    if here.character == ":" and here.line != opening.line:
        message = f"this {kind} is not closed with `{bracket}` before the key on line {here.line}"
        source.report("unclosed", message, opening.span)
        return
    if here.character == "{" and here.before.endswith("$"):
        message = "inside `[]` and `{}` a text with `${` must be in quotes"
        source.report("syntax", message, here.span)
        return
    message = (
        f"`,` or `{bracket}` is missing before this; the {kind} started at line {opening.line}, column {opening.column}"
    )
    source.report("syntax", message, here.span)


def _report_second_colon(source: Source, here: _Position) -> None:
    if re.search(r":\s", here.before):
        source.report(
            "syntax", "a second `: ` on this line; put the text in quotes, or the inner mapping in `{}`", here.span
        )
        return
    message = "a key cannot stand here: check the indentation, and that the line before ends its value"
    width = len(here.before) - len(here.before.lstrip())
    source.report("bad-indentation", message, TextSpan(source.name, here.line, width + 1, here.column + 1))


def _report_misfit(source: Source, here: _Position, opening: _Position) -> None:
    if here.before.strip() == "" and here.column != opening.column:
        message = (
            f"this line is indented by {here.column - 1}, which matches nothing above; "
            f"the block from line {opening.line} is indented by {opening.column - 1}"
        )
        source.report("bad-indentation", message, here.span)
        return
    message = (
        "a list item `- ` and a key cannot stand side by side"
        if here.before.strip() == ""
        else "this is one value too many on this line"
    )
    source.report("syntax", message, here.span)


def _report_by_words(source: Source, reason: str, here: _Position, context: _Position | None) -> None:
    for pattern, code, message in _WORDS:
        if re.search(pattern, reason):
            # A missing quote or colon is reported where the text starts, not where the parser stopped.
            at_start = context is not None and (code == "unclosed" or "missing after" in message)
            source.report(code, message, context.span if context is not None and at_start else here.span)
            return
    source.report("syntax", f"this is not valid YAML: {reason}", here.span)
