"""Writing a session's tables and log to files that other programs read."""

from __future__ import annotations

import csv
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from hdsafebo.files.atomic import replacing
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.chain import write_rows
from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.session.session import Session
from hdsafebo.session.views.summary import is_unsafe
from hdsafebo.session.words import shown

Row = dict[str, Any]
_SUFFIXES = (".csv", ".edf", ".bdf")
_FORMULA = ("=", "+", "-", "@", "|", "%", "\uff1d", "\uff0b", "\uff0d", "\uff20")


def export_session(session: Session, folder: Path, *, recordings: bool = False) -> list[Path]:
    """Write `trials.parquet`, `trials.csv`, `suggestions.csv` and `audit.log`, and the recordings if asked.

    Each file appears whole or not at all; after an error those written before it stay.

    Raises:
        SessionError: a file cannot be written; the message names it.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    session.refresh()
    trials, suggestions = [_trial_row(session, t) for t in session.state.trials], _suggestion_rows(session)
    columns = list(dict.fromkeys(key for row in trials for key in row))
    table = pa.table({c: [row.get(c) for row in trials] for c in columns})
    writers: dict[str, Callable[[Path], object]] = {
        "trials.parquet": partial(pq.write_table, table),
        "trials.csv": partial(_write_csv, columns, trials),
        "suggestions.csv": partial(
            _write_csv, list(suggestions[0]) if suggestions else ["suggestion"], suggestions
        ),
        "audit.log": partial(_write_bytes, write_rows(list(session.entries))),
    }
    if recordings:
        writers |= _recording_writers(session)
    for name, write in writers.items():
        with replacing(folder / name, SessionError) as temporary:
            write(temporary)
    return [folder / name for name in writers]


def _trial_row(session: Session, trial: LoggedTrial) -> Row:
    belief = trial.belief or {}
    row: Row = {
        "trial": trial.number,
        "origin": trial.origin,
        "target": trial.target,
        "status": trial.status,
        "delivered": trial.delivered,
    }
    after: Row = {f"outcome_{t}": (trial.outcomes or {}).get(t) for t in session.space.targets}
    after |= {f"safety_{s.name}": (trial.safety or {}).get(s.name) for s in session.space.safety}
    after |= {f"score_{rater}": score for rater, score in trial.details.get("scores", {}).items()}
    if trial.details.get("mu") is not None:
        after |= {f"mu_{t}": mu for t, mu in zip(session.space.targets, trial.details["mu"], strict=True)}
    after |= {
        "safe": None if trial.safety is None else not is_unsafe(session, trial),
        "predicted_mean": belief.get("objective", {}).get("mean"),
        "predicted_sd": belief.get("objective", {}).get("sd"),
        "predicted_safe_probability": belief.get("safe_probability"),
        "suggestion": trial.suggestion,
        "decided_by": trial.decided_by,
        "reason": trial.reason,
        "failure": trial.failure,
        "started": trial.started,
        "recorded": trial.recorded,
        "recording": (trial.details.get("recording") or {}).get("name"),
    }
    return _with_inputs(row, session.space.row(trial.point), after)


def _suggestion_rows(session: Session) -> list[Row]:
    return [
        _with_inputs(
            {"suggestion": s.number, "target": s.target, "decision": s.decision},
            session.space.row(s.point),
            {
                "predicted_mean": s.belief["objective"]["mean"],
                "predicted_sd": s.belief["objective"]["sd"],
                "predicted_safe_probability": s.belief["safe_probability"],
            },
        )
        for s in session.state.suggestions
    ]


def _with_inputs(before: Row, inputs: Row, after: Row) -> Row:
    """A row with its inputs; one that is called as another column, such as `target`, is `input_target`."""
    taken = {*before, *after}
    return before | {f"input_{n}" if n in taken else n: v for n, v in inputs.items()} | after


def _write_csv(columns: list[str], rows: list[Row], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(safe_cell, columns))
        writer.writerows([safe_cell(row.get(c)) for c in columns] for row in rows)


def safe_cell(value: object) -> object:
    """A cell that no spreadsheet takes for a formula, and that is one line of visible characters.

    Numbers stay as they are. Text that would begin a formula gets an apostrophe in front (OWASP, CSV
    injection).
    """
    if not isinstance(value, str):
        return value
    text = shown(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text


def _recording_writers(session: Session) -> dict[str, Callable[[Path], object]]:
    """One file per recording, named by its trial; the name given by the user supplies only the suffix."""
    writers: dict[str, Callable[[Path], object]] = {}
    for trial in session.state.trials:
        recording = trial.details.get("recording")
        if recording is not None:
            suffix = Path(recording["name"]).suffix.lower()
            name = f"recordings/trial{trial.number:04d}{suffix if suffix in _SUFFIXES else ''}"
            writers[name] = partial(_write_recording, session, recording["sha256"])
    return writers


def _write_recording(session: Session, digest: str, path: Path) -> None:
    _write_bytes(session.store.attachments.content(digest), path)


def _write_bytes(content: bytes, path: Path) -> None:
    path.write_bytes(content)
