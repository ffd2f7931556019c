"""A process that works through a session and says what was acknowledged, to be killed at any moment.

Run as `python -m tests.session.killing DIRECTORY ACKNOWLEDGED`: every step that a call acknowledged is one
line of the file ACKNOWLEDGED.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from hdsafebo.session.session import Session
from tests.session.small import measured, refuse_open


def work(directory: Path, acknowledged: Path) -> None:
    """Suggest, decide and record until killed."""
    with acknowledged.open("ab", buffering=0) as file:

        def acknowledge(text: str) -> None:
            file.write(f"{text}\n".encode())
            os.fsync(file.fileno())

        session = Session.open(directory)
        acknowledge("open")
        while True:
            if session.state.running is None:
                suggestion = session.suggest("ann")
                acknowledge(f"suggested {suggestion.number}")
                if suggestion.number % 5 == 0:
                    refuse_open(session, "no")
                    acknowledge(f"refused {suggestion.number}")
                    continue
                session.approve("ann", suggestion.number)
                acknowledge(f"approved {suggestion.number}")
            running = session.state.running
            assert running is not None
            trial = session.record("ann", measured(running))
            acknowledge(f"recorded {trial.number}")


if __name__ == "__main__":
    work(Path(sys.argv[1]), Path(sys.argv[2]))
