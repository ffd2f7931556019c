"""`python -m hdsafebo` is the command `hdsafebo`."""

from __future__ import annotations

from hdsafebo.cli import main

if __name__ == "__main__":
    main()
