"""Components that exchange messages between agents, and update awareness and knowledge by them."""
