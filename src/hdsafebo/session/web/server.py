"""Serving the page: on this computer only, or with a token."""

from __future__ import annotations

import errno
import re
import secrets
import socket
from contextlib import suppress
from pathlib import Path

from hdsafebo.session.errors import SessionError
from hdsafebo.session.web.guard import is_loopback

_NAME = re.compile(r"[\w.:%-]+")
"""Names and addresses; C ends a name at a zero byte, and takes * for every address."""


def serve(directory: Path, host: str, port: int) -> None:
    """Serve the page of a session until interrupted.

    Args:
        directory: of the session.
        host: address to listen on; one that others can reach needs the token that is printed.
        port: number of the port; 0 takes a free one.

    Raises:
        SessionError: the packages of the page are not installed, there is no session, or nothing can listen
            there.
    """
    try:
        import uvicorn

        from hdsafebo.session.web.app import Page
    except ImportError as error:
        raise SessionError(f"the page needs {error.name}: pip install 'hdsafebo[session]'") from None
    token = None if is_loopback(host) else secrets.token_urlsafe(24)
    page = Page(directory)
    sockets: list[socket.socket] = []
    try:
        sockets = listening(host, port)  # first: the address that is printed is one that answers
        print(page.disclaimer)
        print(address(host, sockets[0].getsockname()[1], token), flush=True)
        with suppress(KeyboardInterrupt):
            uvicorn.Server(uvicorn.Config(page.app(token), log_level="warning")).run(sockets)
    finally:
        for one in sockets:
            one.close()
        page.close()


def address(host: str, port: int, token: str | None) -> str:
    """What a person opens in a browser."""
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + ("" if token is None else f"?token={token}")


def listening(host: str, port: int) -> list[socket.socket]:
    """A socket for every address of a host: `localhost` has two, and another program may hold one of them.

    Raises:
        SessionError: the host or the port does not exist, is taken or needs other rights.
    """
    if not _NAME.fullmatch(host):
        raise SessionError(f"the page cannot listen on {host[:80]!r}: no name or address of a computer")
    sockets: list[socket.socket] = []
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, place in dict.fromkeys(found):
            one = socket.socket(family, kind, protocol)
            sockets.append(one)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            try:
                one.bind((place[0], port or _port_of(sockets[:-1]), *place[2:]))
            except OSError as error:
                if error.errno != errno.EADDRNOTAVAIL:
                    raise
                sockets.pop().close()  # this computer has no address of that family
        for one in sockets:
            one.listen()  # a port that is only bound can be bound twice, and one of the two answers
        if not sockets:
            raise OSError(errno.EADDRNOTAVAIL, "none of its addresses is of this computer")
    except (OSError, OverflowError, UnicodeError) as error:
        for one in sockets:
            one.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise SessionError(f"the page cannot listen on {address(host, port, None)}: {reason}") from None
    return sockets


def _port_of(sockets: list[socket.socket]) -> int:
    """The port that was drawn for the first address; 0 draws one."""
    return int(sockets[0].getsockname()[1]) if sockets else 0
