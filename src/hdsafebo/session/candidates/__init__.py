"""Finite sets of permitted inputs, for sessions that choose among settings."""
