"""`hdsafebo_local`, this project's own method."""
