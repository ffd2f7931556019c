"""The optimiser's side of a session: what it is told, what it suggests, and its state beside the log."""
