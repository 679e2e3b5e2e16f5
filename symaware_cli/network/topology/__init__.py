"""Topologies: who reaches whom."""
