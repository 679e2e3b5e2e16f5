"""Recordings of other programs: runs as bags of ROS 2, and bags as traffic and as sensors of a scenario.

Reasons: docs/decisions/0093-bags.md
"""
