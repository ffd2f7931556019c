"""The local web page of a session: for the person at the bench."""
