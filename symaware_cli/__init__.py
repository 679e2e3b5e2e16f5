"""SymAware: declarative scenarios for multi-agent systems with situational awareness."""

__version__ = "0.1.0"
