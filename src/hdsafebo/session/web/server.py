"""Serving the page: on this computer only, or with a token."""

from __future__ import annotations

import secrets
from pathlib import Path

from hdsafebo.session.errors import SessionError
from hdsafebo.session.web.guard import is_loopback


def serve(directory: Path, host: str, port: int) -> None:
    """Serve the page of a session until interrupted.

    Args:
        directory: of the session.
        host: address to listen on; one that others can reach needs the token that is printed.
        port: number of the port.

    Raises:
        SessionError: the packages of the page are not installed, or there is no session.
    """
    try:
        import uvicorn

        from hdsafebo.session.web.app import Page
    except ImportError as error:
        raise SessionError(f"the page needs {error.name}: pip install 'hdsafebo[session]'") from None
    token = None if is_loopback(host) else secrets.token_urlsafe(24)
    page = Page(directory)
    print(page.disclaimer)
    print(f"http://{host}:{port}/" + ("" if token is None else f"?token={token}"), flush=True)
    try:
        uvicorn.run(page.app(token), host=host, port=port, log_level="warning")
    finally:
        page.close()
