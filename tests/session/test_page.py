"""The page: who may use it, that nothing fires twice, and the whole way in headless Chromium."""

from __future__ import annotations

import fcntl
import json
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from starlette.requests import Request

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.stops import press
from hdsafebo.session.patient.month import answer, simulated_patient
from hdsafebo.session.patient.responses import Responses
from hdsafebo.session.session import Session
from hdsafebo.session.views.believed import believed_best
from hdsafebo.session.web.app import Page, _refusal
from hdsafebo.session.web.guard import Guard, is_loopback
from hdsafebo.session.web.server import address, listening
from tests.session.browser import CHROMIUM, DRIVER, Browser, free_port, wait_for
from tests.session.small import bowl, box_definition

needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="chromium and chromedriver are not installed (apt install chromium-driver)",
)


class Served:
    """A page that is being served."""

    def __init__(self, directory: Path, token: str | None = None) -> None:
        self.page = Page(directory)
        self.port = free_port()
        self.address = f"http://127.0.0.1:{self.port}"
        config = uvicorn.Config(self.page.app(token), port=self.port, log_level="error", ws="none")
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run)
        self._thread.start()
        wait_for(lambda: self._server.started, "the server")

    def stop(self) -> None:
        self._server.should_exit = True
        self._thread.join(20)
        self.page.close()

    def get(self, path: str, **headers: str) -> tuple[int, str]:
        """Status and text of an answer."""
        return _fetch(urllib.request.Request(self.address + path, headers=headers))

    def post(self, step: str, body: Any, **headers: str) -> tuple[int, Any]:
        """Status and content of the answer to a step."""
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        headers = {"X-Session-Page": "1", "Content-Type": "application/json"} | headers
        code, text = _fetch(
            urllib.request.Request(f"{self.address}/api/{step}", data, headers, method="POST")
        )
        return code, json.loads(text) if text.startswith("{") else text

    def status(self) -> Any:
        return json.loads(self.get("/api/status")[1])

    def step(self, step: str, **body: Any) -> tuple[int, Any]:
        """A step as the page sends it."""
        status = self.status()
        return self.post(step, {"who": "ann", "head": status["head"]["hash"], "halt": status["halt"], **body})


def _fetch(request: urllib.request.Request) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(request, timeout=60) as answer_:
            return answer_.status, answer_.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


@pytest.fixture
def bench(make_session: Any) -> Iterator[Served]:
    """The page of a box session."""
    session = make_session()
    session.close()
    served = Served(session.store.directory)
    yield served
    served.stop()


def test_steps_over_the_page_are_steps_of_the_session(bench: Served) -> None:
    assert bench.step("suggest") == (200, {})
    suggestion = bench.status()["suggestion"]
    assert bench.step("approve", suggestion=suggestion["number"]) == (200, {})
    running = bench.status()["running"][0]
    values = bowl(running["point"]["values"])
    assert bench.step("record", trial=running["number"], values=values) == (200, {})
    status = bench.status()
    assert status["running"] == []
    assert status["history"][0]["outcomes"]["speed"] == pytest.approx(values["speed"])
    assert "not a safety system" in status["disclaimer"]
    for picture in ("course", "calibration"):
        code, text = bench.get(f"/api/{picture}.svg")
        assert code == 200
        assert text.startswith("<svg")


def test_a_step_that_fires_twice_is_done_once(bench: Served) -> None:
    head = bench.status()["head"]["hash"]
    assert bench.post("suggest", {"who": "ann", "head": head})[0] == 200
    seen = bench.status()
    body = {"who": "ann", "head": seen["head"]["hash"], "suggestion": seen["suggestion"]["number"]}
    codes: list[int] = []
    threads = [
        threading.Thread(target=lambda: codes.append(bench.post("approve", body)[0])) for _ in range(8)
    ]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert sorted(codes) == [200] + [409] * 7
    assert bench.status()["head"]["seq"] == seen["head"]["seq"] + 1


def test_a_step_is_refused_when_another_program_acts_between_its_look_and_the_step(
    bench: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page has found the log as the person saw it, and then it moves on."""
    other = Session.open(bench.page._viewer.store.directory)
    look = bench.page._refresh
    acts: list[Callable[[], object]] = [lambda: other.note("bob", "meanwhile")]

    def look_and_act(session: Session) -> None:
        look(session)
        if session is bench.page._worker:
            acts[-1]()

    monkeypatch.setattr(bench.page, "_refresh", look_and_act)
    bodies: dict[str, Any] = {
        "note": {"text": "x"},
        "target": {"target": "economy"},
        "manual": {"point": {"values": [0.5, 0.5, 0.0]}, "reason": ""},
        "suggest": {},
    }
    for step, body in bodies.items():
        code, result = bench.step(step, **body)
        assert code == 409, step
        assert "moved on" in result["error"]
    other.stop("bob", "a break")
    assert bench.step("resume")[0] == 409
    acts.append(lambda: other.stop("bob", "it hurts"))
    assert bench.step("resume")[0] == 409
    assert bench.status()["stopped"] == "it hurts"
    kinds = [e.kind for e in Session.open(other.store.directory).entries]
    assert set(kinds) == {"created", "noted", "stopped"}


def test_stop_works_without_having_seen_the_latest(bench: Served) -> None:
    assert bench.post("stop", {"who": "patient", "head": "old", "reason": "it hurts"}) == (200, {})
    assert bench.status()["stopped"] == "it hurts"
    code, result = bench.step("suggest")
    assert code == 422
    assert "stopped" in result["error"]
    assert bench.step("resume")[0] == 200


@pytest.mark.parametrize("body", [b"", b"no json", b"[1]", b'{"who": 7, "reason": []}', b"x" * 2**20])
def test_a_stop_is_taken_however_it_is_sent(bench: Served, body: bytes) -> None:
    code, _ = bench.post("stop", body)
    assert code == 200
    assert bench.status()["stopped"] == "stop button"
    bench.status()
    assert bench.step("resume")[0] == 200
    assert bench.status()["stopped"] is None


def test_a_stop_is_obeyed_before_its_request_has_arrived(bench: Served) -> None:
    with socket.create_connection(("127.0.0.1", bench.port)) as wire:
        head = "POST /api/stop HTTP/1.1|Host: localhost|X-Session-Page: 1|Content-Length: 99||"
        wire.sendall(head.replace("|", "\r\n").encode())
        wait_for(lambda: bench.status()["stopped"], "the stop")
        answer_ = wire.recv(15)
    assert answer_ == b"HTTP/1.1 200 OK"


def test_a_stop_waits_for_nobody(bench: Served) -> None:
    """A suggestion is being computed, 45 requests wait, and another program holds the log."""
    head = bench.status()["head"]["hash"]
    answers: list[int] = []
    bodies = {
        "look": {"point": {"values": [0.5, 0.5, 0.0]}},
        "believed": {},
        "note": {"who": "ann", "head": head, "text": "x"},
        "manual": {"who": "ann", "head": head, "point": {"values": [0.5, 0.5, 0.0]}, "reason": ""},
        "suggest": {"who": "ann", "head": head},
    }
    waiting = [
        threading.Thread(target=lambda s=step: answers.append(bench.post(s, bodies[s])[0]))
        for step in list(bodies) * 9
    ]
    directory = bench.page._viewer.store.directory
    with bench.page._working, (directory / "lock").open("r+b") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for thread in waiting:
            thread.start()
        assert bench.post("stop", {"who": "", "reason": "it hurts"}) == (200, {})
        assert bench.status()["stopped"] == "it hurts"
        assert bench.status()["head"]["hash"] == head  # the log is locked: the stop waits for its place in it
    for thread in waiting:
        thread.join()
    assert len(answers) == 45
    assert set(answers) <= {200, 409, 422}
    status = bench.status()
    assert (status["stopped"], status["running"], status["suggestion"]) == ("it hurts", [], None)
    kinds = [e.kind for e in Session.open(directory).entries]
    assert "stopped" in kinds
    assert not {"manual", "suggested"} & set(kinds)
    assert bench.step("resume")[0] == 200
    assert bench.step("suggest")[0] == 200


def test_a_stop_on_a_disk_that_cannot_be_written_is_obeyed_and_says_so(
    bench: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise SessionError("the disk is gone")

    with monkeypatch.context() as patch:
        patch.setattr("hdsafebo.session.web.app.press", refuse)
        assert bench.post("stop", {"who": "ann"}) == (507, {"error": "stopped, but the disk is gone"})
    assert bench.status()["stopped"] == "stop button"
    assert bench.step("suggest")[0] == 409
    assert bench.step("note", text="notes are taken")[0] == 200
    assert bench.step("resume")[0] == 200
    kinds = [e.kind for e in Session.open(bench.page._viewer.store.directory).entries]
    assert kinds[-2:] == ["stopped", "resumed"]


@pytest.mark.parametrize("kept", [True, False])
def test_nobody_resumes_over_a_stop_that_his_page_does_not_show(
    bench: Served, monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    """Such a resume let trials start while the words of the new stop were still on their way to the disk."""
    assert bench.post("stop", {"who": "ann", "reason": "lunch"})[0] == 200
    wait_for(lambda: bench.status()["halt"] == "", "the stop in the log")
    seen = bench.status()
    writing, go_on = threading.Event(), threading.Event()

    def slow(*words: Any) -> Any:
        writing.set()
        assert go_on.wait(20)
        if not kept:
            raise SessionError("the disk is gone")
        return press(*words)

    monkeypatch.setattr("hdsafebo.session.web.app.press", slow)
    pressing = threading.Thread(target=bench.post, args=("stop", {"who": "bob", "reason": "it hurts"}))
    pressing.start()
    assert writing.wait(20)
    resume = {"who": "ann", "head": seen["head"]["hash"], "halt": seen["halt"]}
    answers = [bench.post("resume", resume), bench.step("resume")]  # not shown; shown, not on the disk yet
    go_on.set()
    pressing.join()
    assert [code for code, _ in answers] == [409, 409]
    assert bench.post("resume", resume)[0] == 409
    assert bench.status()["stopped"] == "it hurts"
    assert bench.step("manual", point={"values": [0.5, 0.5, 0.0]}, reason="")[0] in (409, 422)
    assert bench.step("resume")[0] == 200
    assert bench.status()["stopped"] is None


def test_a_stop_that_others_resume_is_over_here_too(bench: Served) -> None:
    bench.post("stop", {"who": "ann"})
    other = Session.open(bench.page._viewer.store.directory)
    other.resume("bob")
    assert bench.status()["stopped"] is None
    assert bench.step("suggest")[0] == 200


@pytest.mark.parametrize(
    "values",
    ["[NaN, 0.5, 0]", "[null, 0.5, 0]", "[]", '["0.5", 0.5, 0]', "[1e400, 0.5, 0]", "[true, 0.5, 0]"],
)
def test_a_look_at_no_inputs_is_answered_without_a_belief(bench: Served, values: str) -> None:
    code, result = bench.post("look", b'{"point": {"values": ' + values.encode() + b"}}")
    assert code == 422
    assert set(result) == {"error"}


def test_looking_does_not_wait_for_the_model(bench: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdsafebo.session.web.app._MODEL_S", 0.05)
    with bench.page._working:
        code, result = bench.post("look", {"point": {"values": [0.5, 0.5, 0.0]}})
    assert code == 200
    assert result["breaches"] == []
    assert result["belief"] is None
    assert "busy" in result["note"]


def test_looking_at_inputs_changes_nothing(bench: Served) -> None:
    before = bench.status()["head"]
    code, result = bench.post("look", {"point": {"values": [0.5, 0.5, 0.0]}})
    assert code == 200
    assert result["breaches"] == []
    assert result["belief"]["safe_probability"] > 0.9
    assert bench.post("look", {"point": {"values": [0.5, 0.5, 2.0]}})[1]["breaches"]
    assert bench.status()["head"] == before


def test_the_believed_best_is_the_models(bench: Served) -> None:
    """For the present target, with its uncertainty."""
    code, before = bench.post("believed", {})
    assert code == 200
    session = Session.open(bench.page._viewer.store.directory)
    believed = believed_best(session, ["speed"])["speed"]
    assert before["best"] == {
        "number": believed.trial.number,
        "text": session.space.describe(believed.trial.point),
        "mean": believed.mean,
        "deviation": believed.deviation,
    }
    assert bench.step("target", target="economy")[0] == 200
    assert bench.post("believed", {})[1]["best"]["mean"] < 0.0
    session.close()


@pytest.mark.parametrize(
    "body", [b"", b"no json", b"[]", b"{}", b'{"who": 1}', b'{"who": "ann", "head": "x"}', b"[" * 100_000]
)
def test_malformed_requests_are_answered(bench: Served, body: bytes) -> None:
    before = bench.status()["head"]
    for step in ("suggest", "approve", "record", "manual"):
        assert bench.post(step, body)[0] in (400, 409, 422)
    assert bench.status()["head"] == before


def test_other_sites_and_foreign_names_are_turned_away(bench: Served) -> None:
    assert bench.get("/", Host="evil.example")[0] == 403
    request = urllib.request.Request(
        f"{bench.address}/api/stop", b'{"who": "x", "reason": "x"}', method="POST"
    )
    assert _fetch(request)[0] == 403
    assert bench.status()["stopped"] is None
    assert bench.get("/static/../app.py")[0] == 404


@pytest.mark.parametrize(
    "host",
    [
        'a"b.example',
        "a`b.example",
        "a{b}.example",
        "localhost@evil.example",
        "localhost/evil.example",
        "localhost#.evil.example",
        "[evil.example]",
        "localhost.evil.example",
        "evil.example:99999",
        "127.0.0.1:8765:8765",
        "",
        None,
    ],
)
def test_a_name_that_cannot_be_read_is_a_foreign_one(bench: Served, host: str | None) -> None:
    """The library takes it for the server's own, and some of these a browser would look up."""
    named = "" if host is None else f"Host: {host}|"
    for line in (
        "GET /api/status HTTP/1.0|",
        "GET / HTTP/1.0|",
        "POST /api/note HTTP/1.0|X-Session-Page: 1|",
    ):
        with socket.create_connection(("127.0.0.1", bench.port), 10) as wire:
            wire.sendall(f"{line}{named}|".replace("|", "\r\n").encode())
            answer_ = wire.makefile("rb").read()
        assert b" 403 " in answer_.splitlines()[0] or b" 400 " in answer_.splitlines()[0]
        assert b"bench" not in answer_
    for good in ("localhost", "LOCALHOST:1", "127.0.0.1", f"[::1]:{bench.port}"):
        assert bench.get("/api/status", Host=good)[0] == 200


def test_a_token_leads_to_this_page_only(make_session: Any) -> None:
    guard = Guard(lambda *_: None, "secret")  # type: ignore[arg-type,return-value]
    scope = {"type": "http", "method": "GET", "headers": [], "query_string": b"token=secret"}
    answer_ = guard._refusal(Request(scope | {"path": "//evil.example/x"}))
    assert answer_ is not None
    assert answer_.headers["location"] == "/evil.example/x"


def test_every_answer_says_in_words_what_is_wrong(bench: Served, capfd: pytest.CaptureFixture[str]) -> None:
    """Halves of characters, which JSON can name and UTF-8 cannot write; and a session that is gone."""
    head = bench.status()["head"]["hash"].encode()
    half = b'"\\ud800"'
    bodies = {
        "look": b'{"point": {' + half + b": 1}}",
        "manual": b'{"who": "a", "head": "' + head + b'", "reason": "", "point": {' + half + b": 1}}",
        "note": b'{"who": "a", "head": "' + head + b'", "text": [[{' + half + b": 1}]]}",
        "target": b'{"who": "a", "head": "' + head + b'", "target": 1e400}',
    }
    for step, body in bodies.items():
        code, result = bench.post(step, body)
        assert (code, list(result)) == (422, ["error"])
    assert bench.post("stop", b'{"who": "ann", "reason": "it hurts \\ud83d"}')[0] == 200
    assert bench.status()["stopped"] == "it hurts"
    directory = bench.page._viewer.store.directory
    directory.rename(directory.with_name("gone"))
    for path in ("status", "course.svg", "calibration.svg"):
        code, text = bench.get(f"/api/{path}")
        assert code == 422
        assert "is not there any more" in json.loads(text)["error"]
    assert "Traceback" not in "".join(capfd.readouterr())


def test_an_answer_is_written_though_a_folder_has_a_name_that_is_no_utf_8() -> None:
    answer_ = _refusal(SessionError("/home/\udcff/s: is gone"))
    assert json.loads(bytes(answer_.body)) == {"error": "/home/?/s: is gone"}


def test_a_page_that_others_reach_needs_its_token(make_session: Any) -> None:
    session = make_session()
    session.close()
    served = Served(session.store.directory, token="secret-token")
    try:
        assert served.get("/")[0] == 401
        assert served.get("/api/status")[0] == 401
        assert served.get("/?token=wrong")[0] == 401
        assert served.post("stop", {"who": "x", "reason": "x"})[0] == 401
        assert served.get("/", Cookie="hdsafebo_session=secret-token", Host="bench.local")[0] == 200
        assert served.get("/api/status", Cookie="hdsafebo_session=secret-token")[0] == 200
    finally:
        served.stop()


def test_an_address_is_one_that_a_browser_opens_and_a_wrong_one_is_refused_in_words() -> None:
    assert address("::1", 8765, None) == "http://[::1]:8765/"
    assert address("bench", 80, "t") == "http://bench:80/?token=t"
    (first,) = listening("127.0.0.1", 0)
    with first:
        port = first.getsockname()[1]
        assert port > 0
        wrong = [
            ("127.0.0.1", port),
            ("127.0.0.1", 99999),
            ("no such.invalid", 80),
            ("a" * 70 + ".invalid", 80),
            ("127.0.0.1\0", 80),
            ("*", 80),
            ("[::1]", 80),
            ("", 80),
        ]
        for host, number in wrong:
            with pytest.raises(SessionError, match="the page cannot listen on"):
                listening(host, number)
    for one in listening("localhost", 0):
        one.close()


def test_what_counts_as_this_computer() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "localhost", "::1", "[::1]", "127.9.9.9")))
    assert not any(map(is_loopback, ("0.0.0.0", "192.168.1.2", "localhost.example", "", "example.org", "::")))


@needs_browser
def test_the_page_says_nothing_about_inputs_that_were_not_looked_at(
    tmp_path: Path, clinic_files: tuple[Path, Path]
) -> None:
    """All contacts off, then the program gone: no belief of former contacts, nothing to deliver."""
    definition, initial = clinic_files
    create_session(tmp_path / "s", definition, who="ann", initial=initial)
    served = Served(tmp_path / "s")
    find = "document.querySelector(arguments[0])"
    fill = f"return {find}.getAttribute('fill')"
    believed = "return document.querySelector('#belief').textContent"
    ready = "return !document.querySelector('button[data-step=\"Deliver this\"]').disabled"
    try:
        with Browser(tmp_path / "profile") as browser:
            browser.open(served.address)
            browser.type("#who", "Ann")
            wait_for(lambda: browser.text("#title") == "Ready", "the page")
            browser.click("button[data-step=Suggest]")
            wait_for(lambda: browser.text("#title").startswith("Suggestion 1"), "a suggestion")
            change = "document.querySelector('button[data-step=Change]').click();"
            assert browser.run(change + believed) == ""  # until exactly these inputs were looked at
            browser.click("button[data-step=Back]")
            assert browser.run(change + ready) is False
            wait_for(lambda: browser.run(ready), "the look")
            assert "%" in browser.run(believed)
            for contact in range(1, 17):
                box = f"#paddle rect[data-contact='{contact}']"
                while browser.run(fill, box) != "#ffffff":
                    browser.run(f"{find}.dispatchEvent(new Event('click'))", box)
            assert browser.run(believed) == ""
            assert browser.run(ready) is False
            wait_for(lambda: "at least one cathode" in browser.text("#breaches"), "what is wrong")
            assert browser.run(believed) == ""
            assert browser.run(ready) is False
            browser.click("button[data-step=Back]")
            browser.click("button[data-step=Change]")
            wait_for(lambda: browser.run(ready), "the look")
            served.stop()
            browser.run("const i = document.querySelector('#values input'); i.value = '0.1'; i.oninput();")
            assert browser.run(ready) is False
            wait_for(lambda: "cannot be looked at" in browser.text("#breaches"), "the refusal")
            assert browser.run(believed) == ""
            assert browser.run(ready) is False
    finally:
        served.stop()


@needs_browser
def test_the_page_shows_the_inputs_in_the_words_of_the_server(tmp_path: Path) -> None:
    """Six digits of a value between 1,000,000 and 1,000,001 are those of another trial."""
    inputs = [{"name": "a", "lower": 1e6, "upper": 1e6 + 1}, {"name": "b", "lower": 0.0, "upper": 1.0}]
    initial = tmp_path / "initial.csv"
    initial.write_text("a,b,speed,economy,margin\n1000000.25,0.5,1,1,1\n")
    definition = tmp_path / "session.yaml"
    write_mapping(definition, box_definition() | {"inputs": inputs}, ParamsError)
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    session.manual("ann", {"values": [1000000.75, 0.45]})
    served = Served(session.store.directory)
    try:
        with Browser(tmp_path / "profile") as browser:
            browser.open(served.address)
            wait_for(lambda: browser.text("#title").startswith("Trial"), "the running trial")
            assert browser.text("#values").split("\n") == ["a = 1000000.75", "b = 0.45"]
    finally:
        served.stop()


@needs_browser
def test_stop_does_not_wait_for_the_browsers_other_requests(make_session: Any, tmp_path: Path) -> None:
    """A browser keeps six connections to an address; all of them are waiting."""
    session = make_session()
    served = Served(session.store.directory)
    try:
        with Browser(tmp_path / "profile") as browser:
            browser.open(served.address)
            wait_for(lambda: browser.text("#title") == "Ready", "the page")
            with served.page._working:
                browser.run("for (let i = 0; i < 20; i++) call('believed', {}).catch(() => 0);")
                browser.click("#stop")
                wait_for(lambda: browser.text("#stopped").startswith("Stopped"), "the stop")
                assert served.page._halted is not None or session.store.read()
    finally:
        served.stop()


@needs_browser
def test_the_whole_way_in_a_browser(
    tmp_path: Path, responses: Responses, clinic_files: tuple[Path, Path]
) -> None:
    """Suggest, change, approve (clicked five times), record with a file, refuse, stop, resume, own trial."""
    definition, initial = clinic_files
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    patient = simulated_patient(session, responses, 1)
    served = Served(tmp_path / "s")
    try:
        with Browser(tmp_path / "profile") as browser:
            _walk(browser, served, session, patient, tmp_path)
    finally:
        served.stop()


def _walk(browser: Browser, served: Served, session: Session, patient: Any, folder: Path) -> None:
    browser.open(served.address)
    wait_for(lambda: browser.text("#title") == "Ready", "the page")
    assert "not a medical device" in browser.text("#disclaimer")
    browser.click("button[data-step=Suggest]")
    wait_for(lambda: "who is empty" in browser.text("#message"), "the question for a name")
    browser.type("#who", "Ann")
    browser.click("button[data-step=Suggest]")
    wait_for(lambda: browser.text("#title").startswith("Suggestion 1"), "a suggestion")
    session.refresh()
    point = session.state.suggestions[0].point
    signs = browser.run(
        "return [...document.querySelectorAll('#paddle rect[data-contact]')].map(r => r.getAttribute('fill'))"
    )
    assert [s != "#ffffff" for s in signs] == [p != 0 for p in point["polarity"]]
    assert browser.text("#values") == f"{point['current_ma']} mA"
    assert "%" in browser.text("#belief")

    browser.click("button[data-step=Change]")
    browser.type("#values input", "9")
    wait_for(lambda: "the limit" in browser.text("#breaches"), "the limits")
    browser.click("button[data-step=Back]")

    approve = "const b = document.querySelector('button[data-step=Approve]');"
    browser.run(f"{approve} for (let i = 0; i < 5; i++) b.click();")
    wait_for(lambda: browser.text("#title").startswith("Trial 133"), "the trial")
    session.refresh()
    assert [e.kind for e in session.entries].count("approved") == 1

    _, response = answer(session, patient)
    recording = folder / "trial133.csv"
    assert response.recording is not None
    recording.write_bytes(response.recording[:1000])
    browser.type("#file", str(recording))
    for rater, score in response.scores.items():
        browser.type(f"#entries input[name={rater}]", f"{score:g}")
    browser.click("button[data-step=Record]")
    wait_for(lambda: "trial133.csv" in browser.text("#message"), "the refusal of a cut recording")
    recording.write_bytes(response.recording)
    browser.type("#file", str(recording))
    browser.click("button[data-step=Record]")
    wait_for(lambda: browser.text("#title") == "Ready", "the record")
    session.refresh()
    assert session.state.trials[-1].safety == {"score": min(response.scores.values())}
    assert session.state.trials[-1].details["recording"]["name"] == "trial133.csv"
    assert browser.text("#history tbody tr td") == "133"
    wait_for(lambda: "±" in browser.text("#believed"), "the believed best")

    browser.click("button[data-step=Suggest]")
    wait_for(lambda: browser.text("#title").startswith("Suggestion 2"), "the next suggestion")
    browser.click("button[data-step=Refuse]")
    browser.type("#reason", "the patient is tired")
    browser.click("button[data-step=Refuse]")
    wait_for(lambda: browser.text("#title") == "Ready", "the refusal")
    browser.click("#stop")
    wait_for(lambda: "Stopped" in browser.text("#stopped"), "the stop")
    browser.click("#resume")
    wait_for(
        lambda: browser.run("return document.querySelector('button[data-step=Suggest]') !== null"),
        "the resumption",
    )
    browser.click("button[data-step='Own trial']")
    browser.type("#values input", "0.1")
    wait_for(
        lambda: browser.text("#breaches") == "" and browser.text("#belief") != "", "a look at my own trial"
    )
    browser.click("button[data-step='Deliver this']")
    wait_for(lambda: browser.text("#title").startswith("Trial 134 (manual)"), "my own trial")
    session.refresh()
    assert [e.kind for e in session.entries[-4:]] == ["refused", "stopped", "resumed", "manual"]
    assert session.entries[-4].payload["reason"] == "the patient is tired"
    assert all(e.who == "Ann" for e in session.entries[-4:])
    browser.picture(folder / "page.png")
    # the browser notes each refused request as an error of its own; nothing else may be there
    assert [e for e in browser.errors() if "422" not in e] == []


@needs_browser
def test_the_page_of_three_robots_records_in_any_order(make_session: Any, tmp_path: Path) -> None:
    inputs = [{"name": n, "lower": low, "upper": 1.0} for n, low in (("a", 0.0), ("b", 0.0), ("c", -1.0))]
    session = make_session(inputs=inputs, at_once=3)
    served = Served(session.store.directory)
    try:
        with Browser(tmp_path / "profile") as browser:
            browser.open(served.address)
            wait_for(lambda: browser.text("#title") == "Ready", "the page")
            browser.type("#who", "ann")
            for _ in range(2):
                browser.click("button[data-step=Suggest]")
                wait_for(lambda: "Suggestion" in browser.text("#title"), "a suggestion")
                browser.click("button[data-step=Approve]")
                wait_for(lambda: browser.text("#title") == "Ready", "room for another trial")
            browser.click('button[data-step="Record trial 10"]')
            wait_for(lambda: "Trial 10" in browser.text("#title"), "its form")
            for name, value in (("speed", "0.9"), ("economy", "-0.5"), ("margin", "0.1")):
                browser.type(f"#entries input[name={name}]", value)
            browser.click("button[data-step=Record]")
            wait_for(lambda: browser.text("#title") == "Ready", "the record")
            assert [t["number"] for t in served.status()["running"]] == [9]
            assert "Record trial 9" in browser.text("#buttons")
            wait_for(
                lambda: browser.run("return document.querySelectorAll('#slices img').length") == 3, "slices"
            )
            assert browser.errors() == []
    finally:
        served.stop()
