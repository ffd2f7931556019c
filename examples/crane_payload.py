"""A list of 500 stored settings, and a payload that is known each day and not chosen."""

import numpy as np
import pandas as pd
from plants import crane, crane_settings, crane_starts

from hdsafebo import Limit, Objective, Real, Study, System

SETTINGS = pd.DataFrame(crane_settings(np.random.default_rng(7)))
SYSTEM = System(
    name="crane",
    parameters=[
        Real("speed", 0.1, 1.5, unit="m/s"),
        Real("acceleration", 0.2, 4.0, unit="m/s2"),
        Real("lift", 0.05, 0.5, unit="m"),
        Real("grip", 10, 60, unit="N"),
    ],
    contexts=[Real("payload", 0, 5, unit="kg")],
    objective=Objective("cycles", "maximise", unit="1/h"),
    limits=[Limit("sway", at_most=25, unit="mm", noise=0.3), Limit("slack", at_least=0, unit="N", noise=0.3)],
    settings=SETTINGS,
)


def main(payloads=(1.0, 1.4, 0.8, 2.1, 1.7, 2.6), per_day: int = 12, seed: int = 0) -> Study:
    rng = np.random.default_rng(seed)
    study = Study(SYSTEM, alpha=0.95, seed=seed, empty_safe_set="mark")
    study.observe(crane_starts(SETTINGS, 20, payloads[0], rng))
    for payload in payloads:
        for _ in range(per_day):
            suggestion = study.ask(context={"payload": payload})
            if suggestion.marked_unsafe:  # nothing is promised yet: the safest, for a person to decide
                print(payload, "kg: safe with", round(suggestion.safe_probability, 3), suggestion.setting)
            study.tell(suggestion, crane(suggestion.setting, payload, rng))
        print(payload, "kg:", study.best(context={"payload": payload}).believed)
    return study


if __name__ == "__main__":
    main()
