"""The base of errors that users can correct."""

from typing import ClassVar


class UserError(Exception):
    """An error in an input, a file or a network, which a user can change. The message is a sentence that names it.

    Attributes:
        status: The exit status of a verb that it ends.
    """

    status: ClassVar[int] = 2
