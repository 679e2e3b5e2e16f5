"""Maps of floors as obstacles and regions of scenarios, and planners that find paths over them.

Reasons: docs/decisions/0084-maps.md
"""
