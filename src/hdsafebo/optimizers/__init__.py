"""Optimisers, each in a file of its own; `registry` finds them by name."""
