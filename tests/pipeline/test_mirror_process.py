"""Servers that want all memory or all time: the process that talks to them has bounds."""

from __future__ import annotations

import itertools
import os
import signal
import socketserver
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from typing import Any

import psutil
import pytest

from hdsafebo.pipeline.mirror_process import MirrorError, MirrorProcess

BEGIN = {"experiment": "e", "artifacts": None, "run_name": "r", "tags": {}, "params": {}}
MOST_BYTES = 450 * 2**20
OK = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
PIECE = 2**16


def _for_ever(head: bytes, piece: bytes, pause_s: float = 0.0) -> Iterator[bytes]:
    yield head
    while True:
        yield piece
        time.sleep(pause_s)


def _bomb() -> Iterator[bytes]:
    """Little to send, a thousand times as much to read."""
    packer = zlib.compressobj(wbits=31)
    yield OK + b"Content-Encoding: gzip\r\n\r\n"
    while True:
        yield packer.compress(bytes(2**22))


def _large_json() -> Iterator[bytes]:
    """Nothing is wrong with it but its size."""
    begin, end, size = b'{"experiment": {"name": "', b'"}}', 10**9
    yield OK + b"Content-Length: %d\r\n\r\n%b" % (len(begin) + size + len(end), begin)
    yield from itertools.repeat(b"a" * 10**6, size // 10**6)
    yield end


def _redirected(to: bytes) -> Iterator[bytes]:
    yield b"HTTP/1.1 307 A\r\nLocation: %b\r\nContent-Length: 0\r\n\r\n" % to


def _whole(body: bytes) -> Iterator[bytes]:
    yield OK + b"Content-Length: %d\r\n\r\n%b" % (len(body), body)


Answer = Callable[[], Iterator[bytes]]
CHUNKED = OK + b"Transfer-Encoding: chunked\r\n\r\n"
ENDLESS: dict[str, Answer] = {
    "a body without end": lambda: _for_ever(OK + b"\r\n", b" " * PIECE),
    "headers in drops": lambda: _for_ever(OK + b"A: ", b"b", 0.2),
    "'go on' without end": lambda: _for_ever(b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
    "little that becomes much": _bomb,
}
MORE_ENDLESS: dict[str, Answer] = {
    "a body in drops": lambda: _for_ever(OK + b"\r\n", b" ", 0.2),
    "chunks without end": lambda: _for_ever(CHUNKED, b"10000\r\n%b\r\n" % (b" " * PIECE)),
    "the length of a chunk without end": lambda: _for_ever(CHUNKED + b"1;", b"a" * PIECE),
}
WRONG: dict[str, Answer] = {
    "headers without end": lambda: _for_ever(OK, b"A: b\r\n"),
    "one header without end": lambda: _for_ever(OK + b"A: ", b"b" * PIECE),
    "redirected without end": lambda: _redirected(b"/a"),
    "redirected to a file": lambda: _redirected(b"file:///etc/passwd"),
    "lists within lists": lambda: _whole(b"[" * 10**6),
    "numbers without end": lambda: _whole(b'{"experiment": %b}' % (b"9" * 10**6)),
    "other types": lambda: _whole(b'{"experiment": {"experiment_id": {"a": []}, "name": 5, "tags": 7}}'),
    "no JSON": lambda: _whole(b"\x1b[31m \xff\xfe"),
    "closed half-way": lambda: iter([OK + b"Content-Length: 1000\r\n\r\n{"]),
    "no HTTP": lambda: iter([b"\0" * 5000]),
    "an error of any length": lambda: iter([b"HTTP/1.1 400 %b\r\n\r\n%b" % (b"a" * 60_000, b"b" * 10**6)]),
}


class Hostile(socketserver.ThreadingTCPServer):
    """Gives every request the answer that is set."""

    daemon_threads, block_on_close = True, False
    answer: Answer

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answering)
        self.uri = f"http://127.0.0.1:{self.server_address[1]}"


class Answering(socketserver.StreamRequestHandler):
    """Reads a request as far as it has to."""

    def handle(self) -> None:
        assert isinstance(self.server, Hostile)
        with suppress(OSError):
            while self.rfile.readline().strip():
                pass
            for piece in self.server.answer():
                self.wfile.write(piece)


@pytest.fixture
def server() -> Iterator[Hostile]:
    with Hostile() as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


def _children() -> list[psutil.Process]:
    return [c for c in psutil.Process().children() if "hdsafebo.pipeline.mlflow_writer" in c.cmdline()]


@pytest.mark.parametrize("kind", [*ENDLESS, *(pytest.param(k, marks=pytest.mark.slow) for k in MORE_ENDLESS)])
def test_no_server_gets_more_than_its_time_and_memory(
    server: Hostile, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """What MLflow and what it stands on do with an answer is theirs; the process ends at its bounds."""
    monkeypatch.setattr("hdsafebo.pipeline.mirror_process._MOST_BYTES", MOST_BYTES)
    server.answer = (ENDLESS | MORE_ENDLESS)[kind]
    with closing(MirrorProcess(server.uri)) as process:
        assert [c.rlimit(psutil.RLIMIT_DATA) for c in _children()] == [(MOST_BYTES, MOST_BYTES)]
        with pytest.raises(MirrorError):
            process.order("begin", 1.0, BEGIN)
    assert not _children()


def test_too_much_memory_is_said_in_words(server: Hostile, monkeypatch: pytest.MonkeyPatch) -> None:
    """MLflow's own message ends before it says what happened."""
    monkeypatch.setattr("hdsafebo.pipeline.mirror_process._MOST_BYTES", MOST_BYTES)
    server.answer = _large_json
    message = "takes more than 450 MiB of memory"
    with closing(MirrorProcess(server.uri)) as process, pytest.raises(MirrorError, match=message):
        process.order("begin", 60.0, BEGIN)


def test_what_is_no_answer_is_an_error_of_bounded_length(server: Hostile) -> None:
    with closing(MirrorProcess(server.uri)) as process:
        for kind, answer in WRONG.items():
            server.answer = answer
            with pytest.raises(MirrorError) as raised:
                process.order("begin", 60.0, BEGIN)
            assert 0 < len(str(raised.value)) <= 2000, kind
        assert _children(), "none of them was worth its life"


def _stand_in(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """Another program in the place of the writer, which takes seconds to load MLflow."""
    start = subprocess.Popen
    monkeypatch.setattr(
        "hdsafebo.pipeline.mirror_process.subprocess.Popen",
        lambda command, **given: start([sys.executable, "-c", code], **given),
    )


READY = """
import json, os, sys
read = sys.stdin.readline
read()
print(json.dumps({"number": 0, "error": None}), flush=True)
"""
LATE = """
read(), read()
for number, error in (1, "first"), (2, "second"):
    print(json.dumps({"number": number, "error": error}), flush=True)
read()
"""


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("", r"has ended \(exit code 0\)"),
        ('print(\'{"number": 0, "error": "ImportError: no MLflow"}\')', "ImportError: no MLflow"),
        (f"{READY}read(); os._exit(3)", r"has ended \(exit code 3\)"),
        (f"{READY}read(); os.kill(os.getpid(), {int(signal.SIGALRM)})", "has not answered within 2 s"),
        (f"{READY}os.close(0); os._exit(4)", r"has ended \(exit code 4\)"),
    ],
)
def test_a_process_that_ends_is_an_error_in_words(
    monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    _stand_in(monkeypatch, code)
    with pytest.raises(MirrorError, match=message), closing(MirrorProcess("http://127.0.0.1:9")) as process:
        process.order("begin", 2.0, BEGIN | {"run_name": "r" * 10**6})


def test_the_answer_to_an_order_that_was_interrupted_is_not_taken_for_that_to_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _stand_in(monkeypatch, READY + LATE)

    def interrupt(*_: object) -> Any:
        raise KeyboardInterrupt

    former = signal.signal(signal.SIGUSR1, interrupt)
    try:
        with closing(MirrorProcess("http://127.0.0.1:9")) as process:
            threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGUSR1)).start()
            with pytest.raises(KeyboardInterrupt):
                process.order("log_params", 2.0, {"params": {}})
            with pytest.raises(MirrorError, match="second"):
                process.order("finish", 2.0, {"status": "FAILED"})
    finally:
        signal.signal(signal.SIGUSR1, former)
