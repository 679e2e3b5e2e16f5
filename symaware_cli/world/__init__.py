"""Worlds: bodies, models, contacts, rosters and snapshots; sensor readings, time, randomness and numeric arrays."""
