"""Section of the whole body: the task, how long its policies stay up, what they look like, what fails."""

from __future__ import annotations

import numpy as np

from hdsafebo.report.data.body_inputs import REFLEX, BodyInputs, BodyPolicies, BodyPolicy
from hdsafebo.report.data.inputs import StoredFilm, StoredPicture
from hdsafebo.report.data.methods import style
from hdsafebo.report.data.results import Results
from hdsafebo.report.figures.curves import front_figure
from hdsafebo.report.formatting import number
from hdsafebo.report.sections.base import Block, Section, Text, not_run
from hdsafebo.report.sections.experiments import compared, task_blocks
from hdsafebo.report.tables.body import standing_table, standings

TASK = "body"
_INTRO = Text(
    "A body of bones, joints and muscles (myo_sim) is to stay up after a push. A policy is an affine map "
    "from observations to muscle excitations, with one weight for each pair. Objective: mean return over "
    "fixed pushes, which rewards standing and costs sway, tilt, effort and speed. Safety: the body stays up "
    "for a least time, and the torque of joint stops and couplings stays below a limit, after every push. "
    "Initial policies are reflexes with random gains. Methods named after joint torques or reflex gains "
    "search fewer parameters. The model of the arms allows non-commercial use only (MoBL-ARMS)."
)


def body_section(results: Results, body: BodyInputs) -> Section:
    """Curves, return against safety, times to the fall, pictures, and what fails."""
    blocks: list[Block] = [_INTRO, *_pictures(body), *task_blocks(results, TASK)]
    if TASK in results.tasks:
        blocks.append(front_figure(results, TASK, compared(results, TASK)))
    if body.played is None or not body.played.policies:
        blocks.append(not_run("Times until the fall"))
    else:
        blocks.append(standing_table(body.played))
    blocks += _failures(results, body.played)
    return Section("body", "Whole body after a push", "this project", blocks)


def _pictures(body: BodyInputs) -> list[Block]:
    """Strips and the film, or what is missing to draw them."""
    played = body.played
    if played is None or not played.policies:
        return [not_run("Pictures of the body")]
    if played.missing is not None:
        return [Text(f"No pictures of the body: {played.missing}.", "missing")]
    drawn = [policy for policy in played.policies if policy.picture is not None]
    blocks: list[Block] = [
        StoredPicture(_what(policy, played), body.strips[policy.picture])
        for policy in drawn
        if policy.picture in body.strips
    ]
    if body.film is not None and drawn:
        names = " and ".join(style(policy.method).label for policy in reversed(drawn))
        blocks.append(
            StoredFilm(f"The best policy (left) beside a reflex (right), after one push: {names}.", body.film)
        )
    return blocks


def _what(policy: BodyPolicy, played: BodyPolicies) -> str:
    """What a policy did, in words."""
    times = ", ".join(f"{t:g}" for t in policy.known.seconds)
    return (
        f"{style(policy.method).label}, seed {policy.seed}: return {number(policy.objective)}, stays up "
        f"{times} of {played.horizon_s:g} s; five pictures from the start to the end after the first push."
    )


def _failures(results: Results, played: BodyPolicies | None) -> list[Block]:
    """Where methods and policies fall short, said as plainly as where they do not."""
    blocks: list[Block] = []
    if TASK in results.tasks:
        parts = []
        for method in compared(results, TASK):
            table, counts = results.metrics(TASK, method), results.counts(TASK, method)
            unsafe = 1.0 - results.estimate(TASK, method, "safety").mean
            parts.append(
                f"{style(method).label}: {100 * unsafe:.1f} % of the chosen trials unsafe, {counts.marked} "
                f"marked, {int(table['failed'].sum())} failed, {counts.missing} not made"
            )
        blocks.append(Text(f"What fails, trials. {'; '.join(parts)}.", "caution"))
    if played is not None and played.policies:
        texts = [_fall(played, one.method, one.seconds, one.unseen) for one in standings(played)]
        blocks.append(Text(f"What fails, best policies. {' '.join(texts)}", "caution"))
    return blocks


def _fall(played: BodyPolicies, method: str, seconds: np.ndarray, unseen: np.ndarray) -> str:
    limit = played.horizon_s - 1e-6
    known = f"{int((seconds < limit).sum())} of {seconds.size} episodes after known pushes"
    new = f" and {int((unseen < limit).sum())} of {unseen.size} after new ones" if unseen.size else ""
    which = "they are the best of each seed's initial policies; " if method == REFLEX else ""
    return f"{style(method).label}: {which}{known}{new} end in a fall."
