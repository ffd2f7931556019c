"""The tables of the page, as rows and as files."""
