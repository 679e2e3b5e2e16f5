"""How messages get from one agent to another."""
