"""The tasks of the paper as `Problem` objects."""
