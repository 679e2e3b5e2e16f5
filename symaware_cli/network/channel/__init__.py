"""Channels: what becomes of a message on its way over a link."""
