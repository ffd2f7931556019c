"""Sessions at full size: the simulated month, and the time of a suggestion.

    python benchmarks/session.py month --replay      the paper's protocol on ten simulated patients
    python benchmarks/session.py suggest             time of a suggestion with 1,000 trials known
    python benchmarks/session.py stop                time until a pressed STOP is obeyed and kept

All need `data/spinal/stimulation.parquet` (stage traverse_stimulation). A month is a session like any other
and lies in its own directory: started again, it goes on where it ended. With `--write` the numbers are
kept in `reports/reference/benchmarks`, those of the month after each patient.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import socket
import statistics
import threading
import time
import urllib.error
import urllib.request
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.files.atomic import write_json
from hdsafebo.progress import progress, track
from hdsafebo.session.create import create_session
from hdsafebo.session.patient.month import answer, run_month, simulated_patient, write_example
from hdsafebo.session.patient.month_result import evaluate_month
from hdsafebo.session.patient.patient import SimulatedPatient
from hdsafebo.session.patient.responses import MUSCLES, Responses, load_responses
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.spaces.stimulation import CONTACT_COLUMNS, CURRENT_COLUMN
from hdsafebo.session.views.audit import replay, verify_session

REFERENCE = Path("reports/reference/benchmarks")


def main() -> None:
    """Run one of the benchmarks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dataset", type=Path, default=Path("data/spinal/stimulation.parquet"))
    parser.add_argument(
        "--work", type=Path, default=Path("reports/benchmarks/sessions"), help="directory of the sessions"
    )
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {REFERENCE}")
    benchmarks = parser.add_subparsers(required=True, dest="benchmark")
    month = benchmarks.add_parser("month")
    month.add_argument("--patients", type=int, default=10)
    month.add_argument("--first", type=int, default=4000, help="seed of the first patient")
    month.add_argument("--trials", type=int, default=504)
    month.add_argument("--replay", action="store_true", help="compute every suggestion of the logs again")
    suggest = benchmarks.add_parser("suggest")
    suggest.add_argument("--known", type=int, default=1000, help="trials that are known")
    suggest.add_argument("--suggestions", type=int, default=30)
    stop = benchmarks.add_parser("stop")
    stop.add_argument("--known", type=int, default=1000, help="trials that are known")
    stop.add_argument("--presses", type=int, default=20)
    arguments = parser.parse_args()
    responses = load_responses(arguments.dataset)
    {"month": _months, "suggest": _suggest, "stop": _stop}[arguments.benchmark](arguments, responses)


def _months(arguments: argparse.Namespace, responses: Responses) -> None:
    rows: list[dict[str, Any]] = []
    print("improved: true selectivity of the believed best over the initial believed best / measured highest")
    print("measured: highest measurement over the initial highest, as in the paper")
    print("patient  recommended  unsafe  breaches  improved  measured  of reachable: before  after")
    for seed in range(arguments.first, arguments.first + arguments.patients):
        session = _session(arguments.work / f"patient{seed}", responses, seed)
        patient = simulated_patient(session, responses, seed)
        with progress(arguments.trials, f"patient {seed}") as advance:
            run_month(session, patient, trials=arguments.trials, on_trial=lambda trial: advance())
        row = _month(session, patient, seed)
        if arguments.replay:
            row["mismatches"] = len(replay(session))
        rows.append(row)
        session.close()
        if arguments.write:
            _write("session_month.json", {"trials": arguments.trials, "patients": rows})


def _month(session: Session, patient: SimulatedPatient, seed: int) -> dict[str, Any]:
    verdict = verify_session(session)
    result = evaluate_month(session, patient)
    shares = {
        when: float(np.mean([best[m] / result.reachable[m] for m in MUSCLES]))
        for when, best in (("before", result.initial_best), ("after", result.final_best))
    }
    columns = f"{seed:7d}  {result.recommended:11d}  {result.unsafe:6d}  {result.breaches:8d}"
    columns += f"  {result.improved:4d} / {result.improved_on_highest}  {result.improved_measured:8d}"
    print(f"{columns}  {shares['before']:20.3f}  {shares['after']:5.3f}", flush=True)
    return {
        "patient": seed,
        **asdict(result),
        "improved": result.improved,
        "improved_highest": result.improved_highest,
        "improved_on_highest": result.improved_on_highest,
        "improved_measured": result.improved_measured,
        "share_of_reachable": shares,
        "head": verdict.head,
    }


def _suggest(arguments: argparse.Namespace, responses: Responses) -> None:
    directory = arguments.work / f"known{arguments.known}"
    session = _session(directory, responses, 0, known=arguments.known)
    patient = simulated_patient(session, responses, 0)
    wall, cpu = [], []
    for _ in track(range(arguments.suggestions), "suggestions"):
        start, start_cpu = time.perf_counter(), time.process_time()
        session.suggest("benchmark")
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - start_cpu)
        session.approve("benchmark", session.state.suggestions[-1].number)
        _, response = answer(session, patient)
        recording = None if response.recording is None else (response.recording, "trial.csv")
        session.record("benchmark", Report(recording, response.scores))
    session.close()
    start, start_cpu = time.perf_counter(), time.process_time()
    Session.open(directory / "session").advisor()
    reopened, reopened_cpu = time.perf_counter() - start, time.process_time() - start_cpu
    result = {
        "known": arguments.known,
        "wall_s": {"median": statistics.median(wall), "worst": max(wall), "first": wall[0]},
        "cpu_s": {"median": statistics.median(cpu), "worst": max(cpu), "first": cpu[0]},
        "reopen_s": {"wall": reopened, "cpu": reopened_cpu},
    }
    for clock in ("wall_s", "cpu_s"):
        times = result[clock]
        print(
            f"{clock}: median {times['median']:.2f}, worst {times['worst']:.2f}, first {times['first']:.2f}"
        )
    print(f"opening it again: {reopened:.2f} s wall, {reopened_cpu:.2f} s cpu")
    if arguments.write:
        _write(f"session_suggest{'' if arguments.known == 1000 else f'_{arguments.known}'}.json", result)


def _stop(arguments: argparse.Namespace, responses: Responses) -> None:
    """STOP on the page while a suggestion is computed, 45 requests wait and another program holds the log.

    The time is that of the whole request, until the answer is there: the stop is on the disk then.
    """
    directory = arguments.work / f"known{arguments.known}"
    _session(directory, responses, 0, known=arguments.known)
    situations = {"idle": (False, False), "busy": (True, False), "busy and locked": (True, True)}
    result: dict[str, Any] = {"known": arguments.known, "presses": arguments.presses}
    for name, (busy, locked) in situations.items():
        times = [_press_once(directory / "session", busy, locked) for _ in range(arguments.presses)]
        result[name] = {"median_s": statistics.median(times), "worst_s": max(times)}
        print(f"{name}: median {statistics.median(times):.3f} s, worst {max(times):.3f} s")
    if arguments.write:
        _write("session_stop.json", result)


def _press_once(directory: Path, busy: bool, locked: bool) -> float:
    """Seconds until a STOP is answered; the session goes on afterwards."""
    import uvicorn

    from hdsafebo.session.web.app import Page

    page, port = Page(directory), _free_port()
    server = uvicorn.Server(uvicorn.Config(page.app(None), port=port, log_level="error", ws="none"))
    serving = threading.Thread(target=server.run)
    serving.start()
    while not server.started:
        time.sleep(0.01)
    head = json.loads(_request(port, "status"))["head"]["hash"]
    point = page._viewer.state.trials[-1].point
    waiting: list[threading.Thread] = []
    with (directory / "lock").open("r+b") as lock:
        if busy:
            bodies = [("suggest", {"who": "b", "head": head})] + [("look", {"point": point})] * 45
            waiting = [threading.Thread(target=_request, args=(port, step, body)) for step, body in bodies]
            for thread in waiting:
                thread.start()
            time.sleep(0.3)  # the suggestion is under way
        if locked:
            fcntl.flock(lock, fcntl.LOCK_EX)
        start = time.perf_counter()
        _request(port, "stop", {"who": "", "reason": "benchmark"})
        seconds = time.perf_counter() - start
    for thread in waiting:
        thread.join()
    assert json.loads(_request(port, "status"))["stopped"] is not None
    server.should_exit = True
    serving.join()
    Session.open(directory).resume("benchmark")
    return seconds


def _request(port: int, path: str, body: Any = None) -> str:
    """The answer of the page, whatever it is."""
    data = None if body is None else json.dumps(body).encode()
    headers = {"X-Session-Page": "1"}
    request = urllib.request.Request(f"http://127.0.0.1:{port}/api/{path}", data, headers)
    try:
        with urllib.request.urlopen(request, timeout=300) as answered:
            return str(answered.read().decode())
    except urllib.error.HTTPError as error:
        with error:
            return error.read().decode()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _write(name: str, result: dict[str, Any]) -> None:
    REFERENCE.mkdir(parents=True, exist_ok=True)
    write_json(REFERENCE / name, result)


def _session(directory: Path, responses: Responses, seed: int, known: int | None = None) -> Session:
    """The session of a directory; made first where it does not exist."""
    if (directory / "session").exists():
        return Session.open(directory / "session")
    definition, initial = write_example(directory, responses, seed)
    if known is not None:
        initial.write_text(_random_trials(responses, initial, known))
    return create_session(directory / "session", definition, who="benchmark", initial=initial)


def _random_trials(responses: Responses, initial: Path, known: int) -> str:
    """Initial trials at random rows of the model's table, without noise."""
    rng = np.random.default_rng(0)
    header = initial.read_text().split("\n")[0]
    configurations = list(responses.index)
    lines = [header]
    for _ in range(known):
        polarity = list(configurations[int(rng.integers(len(configurations)))])
        current = float(rng.choice(responses.currents_ma[:6]))
        mu, strongest = responses.at({"polarity": polarity, CURRENT_COLUMN: current})
        score = round(10 * (1 - strongest) / (1.05 - strongest))
        lines.append(",".join(map(str, [*polarity, current, *(float(f"{m:.6g}") for m in mu), score, score])))
    assert len(header.split(",")) == len(CONTACT_COLUMNS) + 1 + len(MUSCLES) + 2
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
