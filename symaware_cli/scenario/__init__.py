"""What a scenario file says, turned into objects."""
