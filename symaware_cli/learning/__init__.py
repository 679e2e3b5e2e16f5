"""Learning: scenarios as environments of Gymnasium and PettingZoo (docs/learning.md).

Reasons: docs/decisions/0083-learning.md
"""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
