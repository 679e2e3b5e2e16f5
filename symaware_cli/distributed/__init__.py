"""Runs that are spread over several processes: one is the host of the world, the members run agents."""
