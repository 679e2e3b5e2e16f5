"""Shows marks in Rerun, as columns of archetypes."""
