"""# With a person in the loop

A session asks a person before each trial, keeps hard limits that no model can widen, and writes everything into a log that
shows tampering. This tutorial runs one in Python; [the guide](../session.md) does the same from the command line, with a
page and a stimulator.
"""

# %% The session file says what can be set, how far one step may go, and what is safe.
from pathlib import Path

Path("session.yaml").write_text(
    """
kind: box
name: bench
seed: 1
target: speed
method: {name: hdsafebo_local, settings: {alpha: 0.95}}
inputs:
  - {name: stiffness, lower: 0.0, upper: 2.0, max_step: 0.3, home: 0.5}
  - {name: damping, lower: 0.0, upper: 1.0, max_step: 0.2, home: 0.5}
outcomes: [speed]
safety:
  - {name: margin, threshold: 0.0}
"""
)


def bench(stiffness, damping):  # the machine
    return {
        "speed": 1 - (stiffness - 1.6) ** 2 - (damping - 0.3) ** 2,
        "margin": 1.2 - stiffness + 0.5 * damping,
    }


# %% What was measured before the session, as a table.
rows = [(s, d, *bench(s, d).values()) for s in (0.3, 0.5, 0.7) for d in (0.4, 0.5, 0.6)]
text = "stiffness,damping,speed,margin\n" + "\n".join(",".join(map(str, row)) for row in rows)
Path("initial.csv").write_text(text + "\n")

# %% A session, and twelve suggestions. Ann refuses one and changes another; everything else is approved.
from hdsafebo import create_session
from hdsafebo.session.spaces.space import Report

session = create_session(Path("month"), Path("session.yaml"), who="ann", initial=Path("initial.csv"))
for number in range(1, 13):
    suggestion = session.suggest("ann")
    if number == 4:
        session.refuse("ann", "too close to the last one", suggestion.number)
        continue
    if number == 6:
        wanted = {"values": [suggestion.point["values"][0] - 0.1, suggestion.point["values"][1]]}
        trial = session.modify("ann", wanted, "softer first", suggestion.number)
    else:
        trial = session.approve("ann", suggestion.number)
    session.record("ann", Report(values=bench(*trial.point["values"])))
done = [trial for trial in session.state.trials if trial.origin != "initial"]
print(f"{len(done)} trials, {sum(trial.safety['margin'] >= 0 for trial in done)} of them safe")
print(f"best speed {session.best('speed').outcomes['speed']:.3f}")

# %% A hard limit is not a matter of belief: a step that is too large is refused, whoever asks for it.
from hdsafebo.session.errors import LimitError

try:
    session.manual("ann", {"values": [2.0, 0.0]}, "let us try")
except LimitError as error:
    print("refused:", error)

# %% After a stop no trial starts. In the end the log is checked, and every suggestion is computed again.
from hdsafebo.session.views.audit import replay, verify_session

session.stop("ann", "end of the day")
print("stopped:", session.stopped)
verdict = verify_session(session)
print(f"intact, {verdict.entries} entries; {len(replay(session))} suggestions came out differently")

# %% picture: The trials over stiffness and damping in their order: short steps from the initial settings towards the region where the margin is used up, which is shaded; a diamond marks the trial that Ann changed.
import numpy as np
from matplotlib.figure import Figure

figure = Figure(figsize=(5.5, 3.8), layout="constrained", dpi=110)
chart = figure.subplots()
stiffness, damping = np.meshgrid(np.linspace(0, 2, 100), np.linspace(0, 1, 100))
values = bench(stiffness, damping)
chart.contourf(stiffness, damping, values["margin"], levels=[-9, 0], colors=["#F4C7A5"])
chart.contour(stiffness, damping, values["speed"], levels=8, colors="#9A9A9A", linewidths=0.7)
known = np.array([row[:2] for row in rows])
chart.scatter(*known.T, facecolors="white", edgecolors="#0072B2", zorder=3)
path = np.array([trial.point["values"] for trial in done])
chart.plot(*path.T, color="#0072B2", marker="o", linewidth=0.8)
changed = np.array([trial.point["values"] for trial in done if trial.origin == "modified"])
chart.scatter(*changed.T, marker="D", s=60, color="#E69F00", zorder=4)
chart.set(xlabel="stiffness", ylabel="damping", title="shaded: unsafe; hollow: before the session")
