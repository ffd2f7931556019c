"""How long the best policies of the body stay up, after pushes that trials met and after others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from hdsafebo.report.data.body_inputs import REFLEX, BodyPolicies, BodyPolicy
from hdsafebo.report.data.methods import style
from hdsafebo.report.formatting import number
from hdsafebo.report.tables.results import Cell, Table

_WHOLE = 1e-6
"""s; an episode of the whole length."""


@dataclass(frozen=True)
class Standing:
    """The best policies of one method, one per seed.

    Attributes:
        method: its name, or `reflex`.
        seconds: (seeds, pushes) time until the fall after the pushes that trials met, s.
        unseen: (seeds, unseen pushes) the same after the others; no columns where there are none.
        load: largest torque of joint stops and couplings after any push, N m.
        whole: seeds whose policy stays up to the end after every push that trials met.
        longer: seeds whose policy stays up at least twice as long as the best initial reflex after unseen
            pushes, in the mean over them; None where nothing compares.
    """

    method: str
    seconds: np.ndarray
    unseen: np.ndarray
    load: float
    whole: int
    longer: int | None

    @property
    def seeds(self) -> int:
        """Seeds with a safe policy."""
        return len(self.seconds)


def standings(played: BodyPolicies) -> list[Standing]:
    """One per method, in the order in which they were played, the reflexes first."""
    names = list(dict.fromkeys(policy.method for policy in played.policies))
    reflexes = {p.seed: p.unseen for p in played.policies if p.method == REFLEX}
    found = []
    for name in names:
        own = [policy for policy in played.policies if policy.method == name]
        pairs = [(p.unseen, reflexes.get(p.seed)) for p in own]
        longer = [sum(a.seconds) >= 2 * sum(b.seconds) for a, b in pairs if a is not None and b is not None]
        seconds = np.array([p.known.seconds for p in own])
        found.append(
            Standing(
                method=name,
                seconds=seconds,
                unseen=np.array([[] if p.unseen is None else p.unseen.seconds for p in own]),
                load=max(_loads(own)),
                whole=int((seconds >= played.horizon_s - _WHOLE).all(axis=1).sum()),
                longer=sum(longer) if longer and name != REFLEX else None,
            )
        )
    return found


def _loads(policies: list[BodyPolicy]) -> list[float]:
    return [load for p in policies for o in (p.known, p.unseen) if o is not None for load in o.loads]


def standing_table(played: BodyPolicies) -> Table:
    """Times to the fall per push, medians over seeds."""
    rows, records = [], []
    for one in standings(played):
        medians = [*np.median(one.seconds, axis=0), *np.median(one.unseen, axis=0)]
        mean_unseen = float(one.unseen.mean()) if one.unseen.size else np.nan
        longer = "–" if one.longer is None else f"{one.longer} of {one.seeds}"
        times = [Cell(number(float(value))) for value in medians]
        rows.append(
            [
                Cell(style(one.method).label),
                *times,
                Cell(f"{one.whole} of {one.seeds}"),
                Cell(longer),
                Cell(number(one.load)),
            ]
        )
        named = zip([*played.pushes, *played.unseen_pushes], medians, strict=True)
        records.append(
            {"method": one.method, "seeds": one.seeds}
            | {f"push_{push}_s": float(value) for push, value in named}
            | {"unseen_mean_s": mean_unseen, "whole": one.whole, "longer": one.longer, "load": one.load}
        )
    caption = (
        "Time until the fall in seconds, the median over seeds of each seed's best safe policy, played again "
        f"(an episode has {number(played.horizon_s)} s). Pushes are named by their seeds; those marked new "
        "were met by no trial. Whole: policies that stay up to the end after all pushes that trials met. "
        "Twice: policies that stay up at least twice as long as the best initial reflex of their seed after "
        "new pushes. Load: the largest torque of joint stops and couplings after any push, N m."
    )
    pushes = [*(f"push {p}" for p in played.pushes), *(f"new {p}" for p in played.unseen_pushes)]
    columns = ["Policy", *pushes, "Whole ↑", "Twice ↑", "Load ↓"]
    return Table("body_standing", caption, columns, rows, pd.DataFrame(records))
