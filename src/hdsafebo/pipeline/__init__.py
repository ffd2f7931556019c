"""What every stage of the pipeline stands on.

The command line of a stage, profiles, checked parameters, the code that a stage uses, provenance, tracking.
"""
