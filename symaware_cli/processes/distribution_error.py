"""The error of a process that cannot have its role."""

from symaware_cli.world import UserError


class DistributionError(UserError):
    """This process cannot take the requested role in a run of several processes."""
