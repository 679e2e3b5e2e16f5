"""Marks in Rerun: columns of archetypes."""
