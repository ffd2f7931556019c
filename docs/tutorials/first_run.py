"""# First run

A polishing robot has two settings, and the force on the part must stay below 25 N. You describe what can be set, what
is to be small, and what must never be exceeded; hdsafebo suggests one trial after the other and says beforehand how
probable it is that the trial keeps the limit.
"""

# %% The system, in your own names and units.
from hdsafebo import Limit, Objective, Real, Study, System

system = System(
    name="polisher",
    parameters=[Real("speed", 10, 200, unit="mm/s", log=True), Real("pressure", 0, 8, unit="bar")],
    objective=Objective("roughness", "minimise", unit="um"),
    limits=[Limit("force", at_most=25, unit="N")],
)


# %% One trial. Here a formula stands in for the robot; nothing below looks inside.
def trial(speed, pressure):
    return {"roughness": 9 - pressure + abs(speed - 60) / 30, "force": 2 + 4 * pressure + speed / 50}


# %% A study begins with what was tried already: careful settings far from the limit. Every suggestion is to be safe with a
# probability of at least 0.95.
study = Study(system, alpha=0.95)  # by the model's belief
starts = [{"speed": s, "pressure": p} for s in (15, 25, 40) for p in (0.5, 1.0, 2.0)]
study.observe([start | trial(**start) for start in starts])

# %% Ask, run, tell. `ask` suggests nothing when nothing is believed safe.
for number in range(1, 16):
    suggestion = study.ask()
    measured = trial(**suggestion.setting)
    study.tell(suggestion, measured)
    if number % 5 == 0:
        print(
            f"trial {number}: predicted safe with {suggestion.safe_probability:.3f}, "
            f"force {measured['force']:.1f} N, roughness {measured['roughness']:.2f} um"
        )

# %% What came of it. The best trial is close to the limit: the lowest roughness lies there.
best = study.best().believed
print({name: round(value, 2) for name, value in best.setting.items()})
print({name: round(value, 2) for name, value in best.outcomes.items()})

# %% picture: Left, the trials over speed and pressure: from the known careful settings they move to the edge of the shaded region, where the force is too large, with a few of them elsewhere. Right, the lowest roughness so far over the number of trials.
import numpy as np
from matplotlib.figure import Figure

figure = Figure(figsize=(6.6, 3.2), layout="constrained", dpi=150)
chart, course = figure.subplots(1, 2)
speeds, pressures = np.meshgrid(np.geomspace(10, 200, 200), np.linspace(0, 8, 200))
values = trial(speeds, pressures)
chart.contourf(speeds, pressures, values["force"], levels=[25, 100], colors=["#F4C7A5"])
lines = chart.contour(speeds, pressures, values["roughness"], levels=8, colors="#9A9A9A", linewidths=0.7)
chart.clabel(lines, fontsize=7)
table = study.to_dataframe()
known, asked = table[table["initial"]], table[~table["initial"]]
for group, colour in ((known, "white"), (asked, "#0072B2")):
    for kept, marker in ((True, "o"), (False, "X")):
        part = group[group["safe"] == kept]
        edge = "#0072B2" if kept else "#D55E00"
        face = colour if kept else "#D55E00"
        chart.scatter(
            part["speed"], part["pressure"], marker=marker, facecolors=face, edgecolors=edge, zorder=3
        )
chart.plot(asked["speed"], asked["pressure"], color="#0072B2", linewidth=0.6)
chart.set(xscale="log", xlabel="speed (mm/s)", ylabel="pressure (bar)")
chart.set_title("shaded: force too large\nhollow: known before", fontsize=9)
lowest = table["roughness"].where(table["safe"]).cummin().ffill()
course.step(range(1, len(table) + 1), lowest, where="post", color="#0072B2")
course.axvline(len(known) + 0.5, color="#9A9A9A", linestyle=":")
course.set(xlabel="trial (nine known ones first)", ylabel="lowest safe roughness (um)")
