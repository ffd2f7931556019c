"""The append-only log of a session: its store, the hash chain of its entries, the state they add up to."""
