"""The report: reads result files, writes the page, its figures and tables, and the metrics file.

It imports no optimiser, problem or simulator: what it says follows from files alone.
"""
