"""Who is in the world, how bodies move, what was measured; time, chance and arrays of real numbers."""
