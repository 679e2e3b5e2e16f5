"""Message exchange between agents: links, channels, transmission and inboxes."""
