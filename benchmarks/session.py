"""Sessions at full size: the simulated month, and the time of a suggestion.

    python benchmarks/session.py month --replay      the paper's protocol on ten simulated patients
    python benchmarks/session.py suggest             time of a suggestion with 1,000 trials known

Both need `data/spinal/stimulation.parquet` (stage traverse_stimulation). A month is a session like any other
and lies in its own directory: started again, it goes on where it ended. With `--write` the numbers are
kept in `reports/reference/benchmarks`, those of the month after each patient.
"""

from __future__ import annotations

import argparse
import statistics
import time
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
    arguments = parser.parse_args()
    responses = load_responses(arguments.dataset)
    (_months if arguments.benchmark == "month" else _suggest)(arguments, responses)


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
        session.approve("benchmark")
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
        _write("session_suggest.json", result)


def _write(name: str, result: dict[str, Any]) -> None:
    REFERENCE.mkdir(parents=True, exist_ok=True)
    write_json(REFERENCE / name, result)


def _session(directory: Path, responses: Responses, seed: int, known: int | None = None) -> Session:
    """The session of a directory; made first where it does not exist."""
    if (directory / "session" / "session.db").exists():
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
