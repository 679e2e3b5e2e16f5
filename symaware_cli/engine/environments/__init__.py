"""The kinematic world, and what all worlds share."""
