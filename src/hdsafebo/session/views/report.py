"""One self-contained HTML page about a session: what was done, what came of it, what the model believed."""

from __future__ import annotations

from pathlib import Path

from hdsafebo.files.atomic import replacing
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import verify_session
from hdsafebo.session.views.believed import believed_best
from hdsafebo.session.views.html import Html, join, raw, table, tag
from hdsafebo.session.views.plots import calibration_svg, course_svg, slice_svg
from hdsafebo.session.views.slices import slices
from hdsafebo.session.views.summary import calibration, counts, is_unsafe, promised

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
td, th { padding: .2rem .8rem .2rem 0; text-align: left; border-bottom: 1px solid #d8dee4; }
.unsafe, .notice { color: #b3261e; font-weight: 600; }
.figures { display: flex; flex-wrap: wrap; gap: 1rem; }
figure { margin: 0; flex: 1 1 22rem; max-width: 32rem; }
svg { width: 100%; }
code { overflow-wrap: anywhere; }
.wide { overflow-x: auto; }
"""


def write_report(session: Session, path: Path) -> Path:
    """Write the report; returns its path.

    Raises:
        AuditError: the log or a file it refers to was changed.
        SessionError: the file cannot be written.
    """
    session.refresh()
    verdict = verify_session(session)
    name = session.definition.name
    checked = (
        f", {verdict.entries} log entries, checked, intact, every step by the rules. Head of the log: ",
        tag("code", verdict.head),
        ". Keep this hash elsewhere: a log that was cut or rebuilt does not hold it.",
    )
    body = tag(
        "body",
        tag("h1", name),
        tag("p", session.disclaimer, class_="notice"),
        tag("p", "Session ", tag("code", session.state.session), *checked),
        _overview(session),
        _targets(session),
        _slices(session),
        _calibration(session),
        _unsafe(session),
        _decisions(session),
        _all_trials(session),
    )
    head = raw('<meta charset="utf-8">') + tag("title", name) + raw(f"<style>{_STYLE}</style>")
    with replacing(path, SessionError) as temporary:
        temporary.write_text(f'<!doctype html><html lang="en">{head}{body}</html>\n', encoding="utf-8")
    return path


def _overview(session: Session) -> Html:
    counted = counts(session)
    rows = [(key.replace("_", " "), value) for key, value in counted.items()]
    promise = promised(session)
    method = session.definition.method.name
    text = (
        f"Method {method}, beta = {promise['beta']:.3g}: each suggestion is safe with probability "
        f"{promise['alpha']:.4g} at least, if the model is right."
    )
    return join([tag("h2", "Trials"), tag("p", text), table(("kind", "number"), rows)])


def _targets(session: Session) -> Html:
    rows = []
    believed = believed_best(session)
    for target in session.space.targets:
        first, last = session.best(target, origin="initial"), session.best(target)
        best = believed.get(target)
        rows.append(
            (
                target,
                _value(first, target),
                _value(last, target),
                "" if last is None else session.space.describe(last.point),
                "none" if best is None else f"{best.mean:.4f} ± {2.0 * best.deviation:.4f}",
                "" if best is None else session.space.describe(best.trial.point),
            )
        )
    treated = {t.target for t in session.state.trials if t.target is not None} | {session.state.target}
    figures = [
        tag("figure", raw(course_svg(session, t)), tag("figcaption", t))
        for t in session.space.targets
        if t in treated
    ]
    head = ("target", "highest safe initial", "highest safe", "inputs", "believed best safe", "inputs")
    text = (
        "Highest: the highest single measurement, which is a lucky one. Believed: by a model that weighs it "
        "against similar inputs, repetitions and the effects of days, with two standard deviations."
    )
    return join(
        [tag("h2", "Targets"), tag("p", text), table(head, rows), tag("div", *figures, class_="figures")]
    )


def _slices(session: Session) -> Html:
    target = session.state.target
    best = believed_best(session, [target]).get(target)
    lines = [] if best is None else slices(session, best.trial)
    if best is None or not lines:
        return join([tag("h2", "Slices"), tag("p", "Nothing is believed yet.")])
    text = (
        f"What the model believes of {target} (line: mean, band: two standard deviations) and of safety "
        f"along each input, through the trial believed best (trial {best.trial.number}, "
        f"{session.space.describe(best.trial.point)}). Dots: all trials, wherever their other inputs lie; "
        "red ones were unsafe."
    )
    figures = [tag("figure", raw(slice_svg(line))) for line in lines]
    return join([tag("h2", "Slices"), tag("p", text), tag("div", *figures, class_="figures")])


def _calibration(session: Session) -> Html:
    rows = [
        (
            f"{b.low:g} to {b.high:g}",
            b.trials,
            f"{b.predicted:.4f}",
            f"{b.observed:.4f}",
            f"{b.interval[0]:.3f} to {b.interval[1]:.3f}",
        )
        for b in calibration(session)
    ]
    head = ("predicted safe probability", "trials", "mean prediction", "share safe", "95% interval")
    text = "Recommended trials only. Bars: predicted; dots: observed, with 95% Clopper-Pearson intervals."
    figure = tag("figure", raw(calibration_svg(session)))
    return join([tag("h2", "Calibration"), tag("p", text), figure, table(head, rows)])


def _unsafe(session: Session) -> Html:
    rows = [
        _trial_row(session, t)
        for t in session.state.trials
        if is_unsafe(session, t) and t.origin != "initial"
    ]
    listed = table(_TRIAL_HEAD, rows) if rows else tag("p", "None.")
    return join([tag("h2", "Unsafe trials after the initial ones"), listed])


def _decisions(session: Session) -> Html:
    kinds = (
        "refused",
        "modified",
        "stopped",
        "resumed",
        "target_switched",
        "tightened",
        "abstained",
        "noted",
        "converted",
        "repaired",
    )
    rows = []
    for entry in session.entries:
        if entry.kind in kinds:
            words = [entry.payload.get(key, "") for key in ("reason", "target", "text")]
            words += entry.payload.get("damage", [])
            rows.append(
                (
                    entry.seq,
                    entry.time,
                    entry.who,
                    entry.kind.replace("_", " "),
                    " ".join(w for w in words if w),
                )
            )
    return join([tag("h2", "Decisions and remarks"), table(("entry", "time", "who", "what", "why"), rows)])


def _all_trials(session: Session) -> Html:
    rows = [_trial_row(session, t) for t in session.state.trials]
    return join([tag("h2", "All trials"), tag("div", table(_TRIAL_HEAD, rows), class_="wide")])


_TRIAL_HEAD = ("trial", "chosen by", "inputs", "target", "outcome", "predicted", "safety", "P(safe)", "who")


def _trial_row(session: Session, trial: LoggedTrial) -> tuple[object, ...]:
    target = trial.target or session.state.target
    belief = trial.belief or {}
    safety = ", ".join(f"{k} {v:g}" for k, v in (trial.safety or {}).items())
    return (
        trial.number,
        trial.origin,
        session.space.describe(trial.point),
        trial.target or "",
        _value(trial, target) if trial.outcomes else trial.failure or trial.status,
        f"{belief['objective']['mean']:.3f}" if belief else "",
        safety + (" UNSAFE" if is_unsafe(session, trial) else ""),
        f"{belief['safe_probability']:.4f}" if belief else "",
        trial.decided_by,
    )


def _value(trial: LoggedTrial | None, target: str) -> str:
    return "none" if trial is None or trial.outcomes is None else f"{trial.outcomes[target]:.4f}"
