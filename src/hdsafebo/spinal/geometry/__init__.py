"""Anatomy of the cord T12-S2, its cross-section and mesh, and the conductivity of each tissue."""
