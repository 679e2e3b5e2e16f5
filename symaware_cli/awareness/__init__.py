"""The situational awareness of agents, of themselves and of others, in columns; and their knowledge."""
