"""Roads: lanes as regions of scenarios, and controllers for lane keeping, car following and lane changes.

Reasons: docs/decisions/0096-roads.md
"""
