"""Sessions: trials with a person in the loop. Research software, not a medical device.

`create.create_session(...)` makes a session, `session.Session.open(directory)` opens one; `hdsafebo session
--help` offers the same on the command line, and `hdsafebo session serve` as a local web page.
"""
