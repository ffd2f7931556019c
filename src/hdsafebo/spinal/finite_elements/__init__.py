"""Finite elements: assembly and solution, the lead field of every contact.

Held against an analytic cylinder (`reference_cylinder`, `spinal.verification`).
"""
