"""# Many inputs that move together

A thousand inputs, of which the data show five ways to move together: muscles, heaters, electrodes. An embedding maps the
inputs to five codes, and the search runs over codes. Before anything is optimised over an embedding, measure it.
"""

# %% Settings that somebody recorded: 300 rows of 1,000 inputs, made of five patterns and a little noise.
import numpy as np

from hdsafebo import FunctionProblem, HdSafeBOLocal
from hdsafebo.embeddings.distances import distance_correlation, pair_distances, sample_pairs
from hdsafebo.embeddings.registry import make_embedding

rng = np.random.default_rng(0)
patterns = np.linalg.qr(rng.standard_normal((1000, 5)))[0].T
mixed = 0.5 + 3.0 * rng.uniform(-1, 1, (300, 5)) @ patterns
recorded = np.clip(mixed + 0.005 * rng.standard_normal(mixed.shape), 0, 1)

# %% The embedding, and what is measured of it: are distances kept, and do inputs come back?
embedding = make_embedding("pca", latent_dim=5).fit(recorded, rng=rng)
codes = embedding.encode(recorded)
pairs = sample_pairs(len(recorded), 2000, rng)
kept = distance_correlation(pair_distances(recorded, pairs), pair_distances(codes, pairs))
back = np.abs(embedding.decode(codes) - recorded).mean()
print(f"correlation of distances {kept:.4f}; an input comes back with an error of {back:.4f} on average")

# %% A system with one safety function, here the strength of the whole pattern, and ten careful trials.
goal = np.array([2.0, -1.5, 1.0, -2.0, 1.5])


def run(x):
    pattern = (x - 0.5) @ patterns.T
    return -((pattern - goal) ** 2).sum(1), 3.5 - np.linalg.norm(pattern, axis=1)


problem = FunctionProblem(run, bounds=[[0.0] * 1000, [1.0] * 1000])
starts = recorded[run(recorded)[1] > 1.3][:10]

# %% The same method over codes, within the range of the recorded ones, and over the inputs themselves.
found = {}
ranges = np.stack([codes.min(0), codes.max(0)])
for name, used in (("codes", {"embedding": embedding, "bounds": ranges}), ("inputs", {})):
    optimizer = HdSafeBOLocal(problem, alpha=0.95, seed=0, **used)
    optimizer.observe(starts, *run(starts), initial=True)
    for _ in range(8):
        trials = optimizer.ask(5)
        optimizer.tell(trials, *run(trials.x))
    asked = ~optimizer.trials.initial
    best = np.where(optimizer.feasible, optimizer.trials.objective, -np.inf)
    found[name] = np.maximum.accumulate(best)
    print(
        f"over {name}: best safe value {optimizer.best().objective:.2f} (0 is the highest there is), "
        f"{100 * optimizer.feasible[asked].mean():.0f} % of the trials were safe"
    )

# %% picture: Left, distances between codes over distances between inputs, which lie on a line. Right, the best safe value so far over the number of trials, for the search over codes and for the search over all thousand inputs.
from matplotlib.figure import Figure

figure = Figure(figsize=(6.6, 3.2), layout="constrained", dpi=150)
left, right = figure.subplots(1, 2)
left.scatter(pair_distances(recorded, pairs), pair_distances(codes, pairs), s=3, color="#0072B2", alpha=0.4)
left.set(xlabel="distance between inputs", ylabel="distance between codes")
for (name, values), colour, line in zip(found.items(), ("#D55E00", "#0072B2"), ("-", "--"), strict=True):
    right.step(
        range(1, len(values) + 1), values, where="post", color=colour, linestyle=line, label=f"over {name}"
    )
right.axvline(10.5, color="#9A9A9A", linestyle=":")
right.set(xlabel="trial (ten known ones first)", ylabel="best safe value")
right.legend(frameon=False)
