"""Controllers that plan."""
