"""What a session shows: summary, plots, report, export, audit, and what is believed best.

Nothing here writes to the log.
"""
