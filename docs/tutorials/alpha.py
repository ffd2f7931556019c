"""# How careful should it be?

`alpha` is the probability that a suggestion keeps every limit, as the model believes. This tutorial shows what a larger
alpha costs and what it buys, on a controller with one setting, and then on twenty random controllers.
"""

# %% A controller whose error falls with its gain, and whose overshoot must stay below 10 %.
import numpy as np

from hdsafebo import Limit, NoSafePointError, Objective, Real, Study, System

system = System(
    name="controller",
    parameters=[Real("gain", 0.0, 10.0)],
    objective=Objective("error", "minimise", unit="mm"),
    limits=[Limit("overshoot", at_most=10, unit="%", noise=0.1)],
)


def trial(gain, steep=0.15):
    return {"error": 10 - gain, "overshoot": 2 + steep * gain**2}


def measure(gain, steep, rng):
    result = trial(gain, steep)
    return result | {"overshoot": result["overshoot"] + 0.1 * rng.standard_normal()}


# %% Seven trials are known, the last of them not far from the limit. Up to which gain is safety believed?
ALPHAS = (0.5, 0.8, 0.95, 0.99)
study = Study(system, alpha=0.95)
rng = np.random.default_rng(1)
study.observe([{"gain": gain, **measure(gain, 0.15, rng)} for gain in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)])
gains = np.linspace(1, 10, 181)
table = study.predict({"gain": gains})
reach = {alpha: gains[(table["safe_probability"] < alpha).argmax() - 1] for alpha in ALPHAS}
for alpha, edge in reach.items():
    print(f"alpha {alpha}: gains up to {edge:.2f} are believed safe; in truth up to 7.30 are")

# %% The larger alpha, the shorter the step into the unknown. What comes of eight steps? Ten controllers differ in how
# steeply their overshoot rises, and each gets eight trials with every alpha.
STARTS = np.array([0.3, 0.5, 0.65, 0.8])  # of the largest safe gain, which nobody knows
steeps = rng.uniform(0.12, 0.5, 10)
shares, edges = {}, {}
for alpha in ALPHAS:
    safe, share = [], []
    for steep in steeps:
        largest = np.sqrt(8 / steep)
        study = Study(system, alpha=alpha)
        study.observe([{"gain": gain, **measure(gain, steep, rng)} for gain in largest * STARTS])
        for _ in range(8):
            try:
                suggestion = study.ask()
            except NoSafePointError:  # too little is known: no suggestion, and this controller stays as it is
                break
            study.tell(suggestion, measure(suggestion.setting["gain"], steep, rng))
        asked = study.to_dataframe().query("not initial")["gain"]
        safe += (trial(asked, steep)["overshoot"] <= 10).tolist()
        share.append(study.best().believed.setting["gain"] / largest)
    shares[alpha], edges[alpha] = np.mean(safe), np.mean(share)
    print(
        f"alpha {alpha}: {100 * shares[alpha]:.0f} % of the trials were truly safe, "
        f"the best one reached {100 * edges[alpha]:.0f} % of the largest safe gain"
    )

# %% A promise is about each single trial, and as good as the model. Two things no alpha sees: a bend that begins beyond
# all trials, before it is met; and, far from all trials, that the truth goes on rising. Left in the picture, the belief
# falls back to the average of what is known. This is why methods search near known safe trials.

# %% picture: Left, the overshoot that is believed over the gain, as a mean with a band of two standard deviations that widens beyond the known trials and falls back to their average, and the true one, which rises on; vertical lines show how far the safe set reaches for each alpha. Right, the share of truly safe trials for each alpha, beside the promise.
from matplotlib.figure import Figure

figure = Figure(figsize=(6.6, 3.2), layout="constrained", dpi=150)
left, right = figure.subplots(1, 2)
mean, sd = table["overshoot"], table["overshoot_sd"]
left.fill_between(gains, mean - 2 * sd, mean + 2 * sd, color="#0072B2", alpha=0.2, label="believed, 2 sd")
left.plot(gains, mean, color="#0072B2")
left.plot(gains, trial(gains)["overshoot"], color="#444444", linestyle="--", label="true")
left.axhline(10, color="#D55E00", label="limit")
for edge in reach.values():
    left.axvline(edge, color="#9A9A9A", linewidth=0.8)
left.text(7.1, 0.4, "safe sets end, alpha 0.99 to 0.5", fontsize=7, ha="right")
left.set(xlabel="gain", ylabel="overshoot (%)", ylim=(0, 16))
left.legend(frameon=False, fontsize=8, loc="upper left")
right.plot(list(shares), list(shares.values()), marker="o", color="#0072B2", label="truly safe")
right.plot([0.5, 1], [0.5, 1], color="#9A9A9A", linestyle=":", label="promised")
right.set(xlabel="alpha", ylabel="share of trials", ylim=(0.4, 1.02))
right.legend(frameon=False, fontsize=8)
