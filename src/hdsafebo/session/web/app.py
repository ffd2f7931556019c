"""The page and its interface: one address per step, JSON in and out.

Every step names the head of the log that the person saw. If the log has moved on, the step is refused, so
a button that fires twice, or two open pages, cannot decide twice. `stop` needs no head: it always works.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.errors import ProtocolError, RecordingError
from hdsafebo.session.log.store import MovedOnError
from hdsafebo.session.measuring.recordings import MAX_BYTES
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.views.believed import believed_best
from hdsafebo.session.views.plots import calibration_svg, course_svg
from hdsafebo.session.views.summary import status, trial_data
from hdsafebo.session.web.guard import Guard

STATIC = Path(__file__).parent / "static"
_HISTORY = 200
_MAX_JSON = 2**20
_FILE = "file"  # key of what follows the JSON of a request

Body = dict[str, Any]


class Page:
    """The page of one session.

    Two views of the session are open, so that looking and stopping never wait for a suggestion that is being
    computed.

    Args:
        directory: of the session.
    """

    def __init__(self, directory: Path) -> None:
        self._worker, self._viewer = Session.open(directory), Session.open(directory)
        self._working, self._viewing = threading.Lock(), threading.Lock()

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
            "resume": lambda b: self._worker.resume(b["who"]),
            "target": lambda b: self._worker.switch_target(b["who"], b["target"]),
            "note": lambda b: self._worker.note(b["who"], b["text"]),
        }
        routes = [
            Route("/", lambda request: FileResponse(STATIC / "page.html")),
            Mount("/static", StaticFiles(directory=STATIC)),
            Route("/api/status", self._read(lambda request: JSONResponse(self._status()))),
            Route(
                "/api/course.svg",
                self._read(lambda request: _svg(course_svg(self._viewer, self._viewer.state.target))),
            ),
            Route("/api/calibration.svg", self._read(lambda request: _svg(calibration_svg(self._viewer)))),
            Route("/api/stop", self._answer(self._stop), methods=["POST"]),
            Route("/api/look", self._answer(self._look), methods=["POST"]),
            Route("/api/believed", self._answer(self._believed), methods=["POST"]),
            *(
                Route(f"/api/{name}", self._answer(self._step(act)), methods=["POST"])
                for name, act in steps.items()
            ),
        ]
        return Guard(Starlette(routes=routes), token)

    def close(self) -> None:
        """Close both views."""
        self._worker.close()
        self._viewer.close()

    def _status(self) -> Body:
        session = self._viewer
        trials = session.state.trials[-_HISTORY:]
        space = session.space
        return status(session) | {
            "inputs": list(space.inputs),
            "entries": list(space.entries),
            "takes_recordings": space.takes_recordings,
            "safety_limits": {s.name: s.threshold for s in space.safety},
            "history": [trial_data(session, t) for t in reversed(trials)],
        }

    def _step(self, act: Callable[[Body], Any]) -> Callable[[Body], Any]:
        """A step that needs the log to be where the person saw it."""

        def run(body: Body) -> None:
            with self._working:
                self._worker.refresh()
                head = self._worker.state.head
                if head is None or body.get("head") != head.hash:
                    raise MovedOnError("the session has moved on: look again, then decide")
                act(body)

        return run

    def _record(self, body: Body) -> None:
        recording = None
        if body.get("recording") is not None:
            content = body.pop(_FILE, b"")
            if len(content) != body["recording"]["bytes"]:
                raise RecordingError("the recording was not sent whole: choose the file again")
            recording = (content, Path(str(body["recording"]["name"])).name)
        report = Report(recording, body["values"])
        self._worker.record(body["who"], report, body["trial"], remark=body.get("remark", ""))

    def _stop(self, body: Body) -> None:
        with self._viewing:
            self._viewer.stop(body["who"] or "unnamed", body.get("reason") or "stop button")

    def _look(self, body: Body) -> Body:
        """Limits and belief of inputs that a person is editing."""
        with self._working:
            session = self._worker
            session.refresh()
            point = session.space.point(body["point"])
            breaches = session.space.breaches(point, session.state.last_point)
            return {
                "text": session.space.describe(point),
                "breaches": breaches,
                "belief": session.believe(point),
            }

    def _believed(self, body: Body) -> Body:
        """The trial believed best of the present target; not part of the status, since it costs a fit."""
        with self._working:
            session = self._worker
            session.refresh()
            target = session.state.target
            best = believed_best(session, [target]).get(target)
            if best is None:
                return {"best": None}
            text = session.space.describe(best.trial.point)
            shown = {"number": best.trial.number, "text": text, "mean": best.mean}
            return {"best": shown | {"deviation": best.deviation}}

    def _read(self, answer: Callable[[Request], Response]) -> Any:
        def run(request: Request) -> Response:
            with self._viewing:
                self._viewer.refresh()
                return answer(request)

        async def endpoint(request: Request) -> Response:
            return await run_in_threadpool(run, request)

        return endpoint

    def _answer(self, act: Callable[[Body], Any]) -> Any:
        """Read the body, act, and turn errors into messages."""

        async def endpoint(request: Request) -> Response:
            try:
                body = await _read_body(request)
                result = await run_in_threadpool(act, body)
                return JSONResponse(result if isinstance(result, dict) else {})
            except MovedOnError as error:
                return JSONResponse({"error": str(error)}, 409)
            except HdSafeBOError as error:
                return JSONResponse({"error": str(error)}, 422)
            except (KeyError, TypeError, AttributeError) as error:
                return JSONResponse({"error": f"malformed request: {error!r}"}, 400)

        return endpoint


async def _read_body(request: Request) -> Body:
    """The JSON of a request, and the file that follows its first line: as it is, since no copy is small."""
    content = bytearray()
    async for chunk in request.stream():
        content += chunk
        if len(content) > MAX_BYTES + _MAX_JSON:
            raise ProtocolError(f"more than {MAX_BYTES + _MAX_JSON} bytes were sent")
    end = content.find(b"\n")
    file = b"" if end < 0 else bytes(memoryview(content)[end + 1 :])
    del content[end if end >= 0 else len(content) :]
    try:
        body = json.loads(content)
    except (ValueError, RecursionError):
        raise ProtocolError("expected JSON") from None
    if not isinstance(body, dict) or not isinstance(body.get("who", ""), str):
        raise ProtocolError("expected a JSON object with a name as `who`")
    return body | {_FILE: file}


def _svg(text: str) -> Response:
    return Response(text, media_type="image/svg+xml")
