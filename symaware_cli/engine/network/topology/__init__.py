"""Topologies: which agents have communication links."""
