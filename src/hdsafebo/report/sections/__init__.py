"""The sections of the page: figures, tables and sentences computed from the results."""
