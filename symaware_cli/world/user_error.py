"""The base of errors that users are told in a sentence."""

from typing import ClassVar


class UserError(Exception):
    """What a user can change: an input, a file, a network. The message is a sentence that names it.

    Attributes:
        status: The exit status of a verb that it ends.
    """

    status: ClassVar[int] = 2
