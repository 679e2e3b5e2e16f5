"""Support for tests of the conformance kit: the text of the deviations that a check finds."""

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from symaware_cli.testing import ConformanceError

Check = Callable[..., None]


def deviations(check: Check, kind: type, *arguments: Any, **parameters: Any) -> str:
    """Return the message of a check about a plugin that does not conform."""
    with pytest.raises(ConformanceError) as caught:
        check(kind, *arguments, **parameters)
    said = str(caught.value)
    assert all(line.startswith(kind.__name__) for line in said.splitlines()), said
    return said


def is_located(said: str, kind: type) -> bool:
    """Whether a line of the class is named."""
    lines, first = inspect.getsourcelines(kind)
    file = Path(inspect.getfile(kind)).name
    found = [int(number) for number in re.findall(rf"\({re.escape(file)}, line (\d+)\)", said)]
    return any(first <= number < first + len(lines) for number in found)
