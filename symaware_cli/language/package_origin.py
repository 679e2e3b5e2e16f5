"""Where the installed SymAware came from: a commit or a wheel, as recorded by pip and Git (PEP 610)."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from symaware_cli.entry_points import DISTRIBUTION, package_file

#: The name under which logs and sweeps note it beside the versions.
ORIGIN = "SymAware from"

_COMMIT = re.compile("[0-9a-f]{40}|[0-9a-f]{64}")


@cache
def package_origin() -> str | None:
    """Return where SymAware came from, without paths of this machine; None if it was not recorded.

    It is ``git+URL@COMMIT``, ``commit COMMIT`` of a checkout, or ``FILE, SHA-256 HASH`` of a wheel.
    """
    try:
        noted = package_file(DISTRIBUTION, "direct_url.json")
        content: Any = json.loads(noted or "{}")
        address = urlsplit(str(content.get("url", "")))
        if "vcs_info" in content:
            return f"git+{content['url']}@{content['vcs_info']['commit_id']}"
        if "dir_info" in content:
            commit = _commit_of(Path(unquote(address.path)))
            return None if commit is None else f"commit {commit}"
        name = Path(unquote(address.path)).name
        digest = content["archive_info"].get("hashes", {}).get("sha256")
        return f"{name}, SHA-256 {digest}" if digest else name or None
    except (AttributeError, LookupError, OSError, TypeError, ValueError):
        return None


def _commit_of(checkout: Path) -> str | None:
    """The commit that is checked out in a folder; None if it is no checkout. Git itself need not be installed."""
    folder = checkout / ".git"
    if folder.is_file():  # of a further work tree
        folder = checkout / folder.read_text().removeprefix("gitdir:").strip()
    head = (folder / "HEAD").read_text().strip()
    common = folder / "commondir"
    shared = folder / common.read_text().strip() if common.is_file() else folder
    if head.startswith("ref:"):
        name = head.removeprefix("ref:").strip()
        packed = shared / "packed-refs"
        listed = packed.read_text() if packed.is_file() else ""
        found = re.search(rf"^(\S+) {re.escape(name)}$", listed, re.MULTILINE)
        loose = shared / name
        head = loose.read_text().strip() if loose.is_file() else found[1] if found else ""
    return head if _COMMIT.fullmatch(head) else None
