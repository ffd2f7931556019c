"""The page and its interface: one address per step, JSON in and out.

Every step names the head of the log that the person saw. If the log has moved on, the step is refused, so
a button that fires twice, or two open pages, cannot decide twice.

STOP has a way of its own: it is obeyed in memory before its request is even read to the end, and written by a
thread that does nothing else. It needs no head, no name, no lock, and no place in the queue of the others.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.errors import ProtocolError, RecordingError, SessionError, StoppedError
from hdsafebo.session.log.stops import press
from hdsafebo.session.log.store import MovedOnError, utc_now
from hdsafebo.session.measuring.recordings import MAX_BYTES
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.views.believed import believed_best
from hdsafebo.session.views.plots import calibration_svg, course_svg, slice_svg
from hdsafebo.session.views.slices import slices
from hdsafebo.session.views.summary import status, trial_data
from hdsafebo.session.web.guard import Guard
from hdsafebo.session.words import LONGEST, parse_json, trimmed_text

STATIC = Path(__file__).parent / "static"
_HISTORY = 200
_MAX_BODY = MAX_BYTES + 2**20  # a recording, and the JSON of its step
_MAX_STOP_BODY = 2**16
_STOP_BODY_S = 0.2  # waited for the words of a stop that is obeyed already
_MODEL_S = 2.0  # waited for the model by somebody who only looks
_LOOKS_AT_ONCE, _STEPS_AT_ONCE = 4, 8  # more wait without keeping others from their threads
_BARRED = ("suggest", "approve", "modify", "manual")  # steps that may start a trial
_FILE = "file"  # key of what follows the JSON of a request

Body = dict[str, Any]


@dataclass(eq=False)
class _Halt:
    """A STOP that is obeyed.

    Attributes:
        reason: as far as it is known.
        token: names it in the log; empty until it is on the disk.
        ended: it is on the disk, or cannot be kept there.
        name: tells people's views of it from those of another one.
    """

    reason: str = "STOP"
    token: str = ""
    ended: bool = False
    name: str = field(default_factory=lambda: secrets.token_hex(8))


class Page:
    """The page of one session.

    Two views of the session are open, so that looking never waits for a suggestion that is being computed.

    Args:
        directory: of the session.
    """

    def __init__(self, directory: Path) -> None:
        self._worker, self._viewer = Session.open(directory), Session.open(directory)
        self._working, self._viewing = threading.Lock(), threading.Lock()
        self._directory = directory
        self._halted: _Halt | None = None  # STOP was pressed here, and the log does not say so yet
        self._halting = threading.Lock()  # held for no longer than an assignment takes
        self._looks, self._steps = CapacityLimiter(_LOOKS_AT_ONCE), CapacityLimiter(_STEPS_AT_ONCE)

    def app(self, token: str | None) -> Guard:
        """The ASGI application; `token` None serves loopback names only."""
        steps: dict[str, Callable[[Body], Any]] = {
            "suggest": lambda b: self._worker.suggest(b["who"]),
            "approve": lambda b: self._worker.approve(b["who"], b["suggestion"]),
            "modify": lambda b: self._worker.modify(b["who"], b["point"], b["reason"], b["suggestion"]),
            "refuse": lambda b: self._worker.refuse(b["who"], b["reason"], b["suggestion"]),
            "manual": lambda b: self._worker.manual(b["who"], b["point"], b["reason"]),
            "record": self._record,
            "not-delivered": lambda b: self._worker.not_delivered(b["who"], b["reason"], b["trial"]),
            "resume": self._resume,
            "target": lambda b: self._worker.switch_target(b["who"], b["target"]),
            "note": lambda b: self._worker.note(b["who"], b["text"]),
        }
        routes = [
            Route("/", lambda request: FileResponse(STATIC / "page.html")),
            Mount("/static", StaticFiles(directory=STATIC)),
            Route("/api/status", self._read(lambda request: _Json(self._status()))),
            Route(
                "/api/course.svg",
                self._read(lambda request: _svg(course_svg(self._viewer, self._viewer.state.target))),
            ),
            Route("/api/calibration.svg", self._read(lambda request: _svg(calibration_svg(self._viewer)))),
            Route("/api/stop", self._stop, methods=["POST"]),
            Route("/api/look", self._answer(self._look, looks=True), methods=["POST"]),
            Route("/api/believed", self._answer(self._believed, looks=True), methods=["POST"]),
            *(
                Route(f"/api/{name}", self._answer(self._step(name, act)), methods=["POST"])
                for name, act in steps.items()
            ),
        ]
        return Guard(Starlette(routes=routes), token)

    @property
    def disclaimer(self) -> str:
        """Of the session."""
        return self._viewer.disclaimer

    def close(self) -> None:
        """Close both views."""
        self._worker.close()
        self._viewer.close()

    def _status(self) -> Body:
        session = self._viewer
        trials = session.state.trials[-_HISTORY:]
        space = session.space
        halt = self._halted
        return status(session) | {
            "stopped": session.stopped if halt is None else halt.reason,
            "halt": "" if halt is None else halt.name,
            "inputs": list(space.inputs),
            "entries": list(space.entries),
            "takes_recordings": space.takes_recordings,
            "safety_limits": space.limits(),
            "history": [trial_data(session, t) for t in reversed(trials)],
        }

    def _step(self, name: str, act: Callable[[Body], Any]) -> Callable[[Body], Any]:
        """A step that needs the log to be where the person saw it, and no STOP when it may start a trial."""

        def run(body: Body) -> None:
            with self._working:
                self._refresh(self._worker)
                head = self._worker.state.head
                if head is None or body.get("head") != head.hash:
                    raise MovedOnError("the session has moved on: look again, then decide")
                self._require_not_halted(name, "")
                with self._worker.seen_at(head.hash):
                    act(body)
                self._require_not_halted(name, ": do not deliver this trial, close it as not delivered")

        return run

    def _refresh(self, session: Session) -> None:
        """Take in what happened; from a stop that is in the log on, the log says whether it still holds."""
        session.refresh()
        halt = self._halted
        if halt is not None and halt.token in session.state.stops:
            self._is_over(halt)

    def _is_over(self, halt: _Halt | None) -> None:
        """Obey a stop no longer, unless it is another one by now: somebody pressed again."""
        with self._halting:
            if self._halted is halt:
                self._halted = None

    def _require_not_halted(self, name: str, what_to_do: str) -> None:
        if self._halted is not None and name in _BARRED:
            raise StoppedError(f"STOP was pressed ({self._halted.reason}){what_to_do}")

    def _resume(self, body: Body) -> None:
        """Go on; a stop that could not be kept on the disk is written into the log first.

        Nobody goes on over a stop that his page did not show yet, or that is still being written down.
        """
        halt, known = self._halted, len(self._worker.entries)
        if halt is not None and (body.get("halt") != halt.name or not halt.ended):
            raise MovedOnError("STOP was pressed meanwhile: look, then resume")
        if halt is not None and not halt.token:
            self._worker.stop(body["who"], halt.reason)
        added = self._worker.entries[known:]
        if len(added) > 1:
            raise MovedOnError("the session was stopped again meanwhile: look, then resume")
        with self._worker.seen_at(added[-1].hash if added else body["head"]):
            self._worker.resume(body["who"])
        self._is_over(halt)

    def _record(self, body: Body) -> None:
        recording = None
        if body.get("recording") is not None:
            content = body.pop(_FILE, b"")
            if len(content) != body["recording"]["bytes"]:
                raise RecordingError("the recording was not sent whole: choose the file again")
            recording = (content, Path(str(body["recording"]["name"])).name)
        report = Report(recording, body["values"])
        self._worker.record(body["who"], report, body["trial"], remark=body.get("remark", ""))

    async def _stop(self, request: Request) -> Response:
        """Obey first, then read who and why, then write it down."""
        halt = _Halt()
        with self._halting:
            self._halted = halt
        words = await _words_of_stop(request)
        halt.reason = trimmed_text(words.get("reason"), LONGEST, "stop button")
        done: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        threading.Thread(target=self._keep, args=(halt, words.get("who"), done), daemon=True).start()
        problem = await done
        return _Json({"error": f"stopped, but {problem}"} if problem else {}, 507 if problem else 200)

    def _keep(self, halt: _Halt, who: object, done: asyncio.Future[str]) -> None:
        """Keep a stop on the disk; the log takes it in as soon as it can."""
        problem = ""
        try:
            halt.token = press(self._directory, who, halt.reason, utc_now()).token
        except SessionError as error:
            problem = str(error)
        halt.ended = True
        done.get_loop().call_soon_threadsafe(done.set_result, problem)

    def _look(self, body: Body) -> Body:
        """Limits and belief of inputs that a person is editing.

        The limits never wait for the model. A belief is always that of the point in the answer.
        """
        with self._viewing:
            session = self._viewer
            self._refresh(session)
            point = session.space.point(body["point"])
            breaches = session.space.breaches(point, session.state.last_point)
            seen = {
                "point": point,
                "text": session.space.describe(point),
                "breaches": breaches,
                "belief": None,
            }
        if breaches:
            return seen
        if not self._working.acquire(timeout=_MODEL_S):
            return seen | {"note": "the model is busy with something else"}
        try:
            return seen | {"belief": self._worker.believe(point)}
        finally:
            self._working.release()

    def _believed(self, body: Body) -> Body:
        """The trial believed best of the present target, and slices through it.

        Not part of the status, since they cost fits.
        """
        with self._working:
            session = self._worker
            session.refresh()
            target = session.state.target
            best = believed_best(session, [target]).get(target)
            if best is None:
                return {"best": None, "slices": []}
            text = session.space.describe(best.trial.point)
            shown = {"number": best.trial.number, "text": text, "mean": best.mean}
            figures = [{"name": s.name, "svg": slice_svg(s)} for s in slices(session, best.trial)]
            return {"best": shown | {"deviation": best.deviation}, "slices": figures}

    def _read(self, answer: Callable[[Request], Response]) -> Any:
        def run(request: Request) -> Response:
            with self._viewing:
                self._refresh(self._viewer)
                return answer(request)

        async def endpoint(request: Request) -> Response:
            try:
                return await run_sync(run, request)
            except Exception as error:
                return _refusal(error)

        return endpoint

    def _answer(self, act: Callable[[Body], Any], *, looks: bool = False) -> Any:
        """Read the body, act, and turn errors into messages.

        Args:
            act: what to do.
            looks: the request only looks at the model; few of them are served at a time.
        """

        async def endpoint(request: Request) -> Response:
            try:
                content = await _read_body(request)
                result = await run_sync(_acted, act, content, limiter=self._looks if looks else self._steps)
                return _Json(result if isinstance(result, dict) else {})
            except (KeyError, TypeError, AttributeError) as error:
                return _Json({"error": f"malformed request: {error!r}"}, 400)
            except Exception as error:
                return _refusal(error)

        return endpoint


class _Json(JSONResponse):
    """An answer that can be written whatever it says: names of folders need not be UTF-8."""

    def render(self, content: Any) -> bytes:
        """The body."""
        text = json.dumps(content, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
        return text.encode("utf-8", "replace")


def _refusal(error: Exception) -> Response:
    """What a person is told who asked for something that cannot be done."""
    if isinstance(error, MovedOnError | StoppedError):
        return _Json({"error": str(error)}, 409)
    if isinstance(error, HdSafeBOError):
        return _Json({"error": str(error)}, 422)
    return _Json({"error": f"an error of this program: {error!r}"}, 500)


def _acted(act: Callable[[Body], Any], content: bytes) -> Any:
    """The result of a step, for the body of its request."""
    end = content.find(b"\n")  # the JSON is one line; a file follows as it is, since no copy of one is small
    head, file = (content, b"") if end < 0 else (content[:end], content[end + 1 :])
    body = parse_json(head)
    if not isinstance(body, dict) or not isinstance(body.get("who", ""), str):
        raise ProtocolError("expected a JSON object with a name as `who`")
    return act(body | {_FILE: file})


async def _words_of_stop(request: Request) -> Body:
    """What the request of a stop says, as far as it comes at once and can be read."""
    content = b""
    try:
        async with asyncio.timeout(_STOP_BODY_S):
            async for chunk in request.stream():
                content += chunk[: _MAX_STOP_BODY - len(content)]
        body = parse_json(content, writable=False)  # what can be kept of the words is kept
    except (TimeoutError, ClientDisconnect, HdSafeBOError):
        return {}
    return body if isinstance(body, dict) else {}


async def _read_body(request: Request) -> bytes:
    chunks, size = [], 0
    async for chunk in request.stream():
        size += len(chunk)
        if size > _MAX_BODY:
            raise ProtocolError(f"more than {_MAX_BODY} bytes were sent")
        chunks.append(chunk)
    return b"".join(chunks)


def _svg(text: str) -> Response:
    return Response(text, media_type="image/svg+xml")
