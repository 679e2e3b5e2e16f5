"""Files with the results of a command for continuous integration: test cases, and the formats that show them.

Reasons: docs/decisions/0085-results-for-continuous-integration.md
"""
