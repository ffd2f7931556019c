"""# A policy for an environment

A cart is to drive to a mark in front of a wall, as fast as it can and without touching the wall. The search is over
policies, and a trial is an episode. Any Gymnasium environment whose spaces are boxes works the same way.
"""

# %% The environment. The wall is at 1.2, the mark at 1.0; who touches the wall has lost.
import gymnasium
import numpy as np


class Cart(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = np.array([self.np_random.uniform(-0.1, 0.1), 0.0])
        return self.state, {}

    def step(self, action):
        position, speed = self.state
        speed = 0.99 * speed + 0.01 * float(action[0])
        self.state = np.array([position + speed, speed])
        reward = -abs(self.state[0] - 1.0) - 0.01 * float(action[0]) ** 2
        return self.state, reward, self.state[0] >= 1.2, False, {"position": self.state[0]}


# %% What must not happen: the largest position that the environment reports must stay below 1.2. A distance teaches
# the model more than a crash that did or did not happen. (A policy's observations end before a crash, so that a
# limit on them alone would miss it.)
from hdsafebo import GymnasiumPolicies, HdSafeBOLocal, budget, gaussian_design

distance = budget("position", 1.2, reduce=max, name="distance")
problem = GymnasiumPolicies(Cart, [distance], seeds=(1, 2), horizon=60, design=gaussian_design(0.01, 0.1))
print(f"{problem.policies.dimension} weights of an affine policy")

# %% Initial policies of all sizes, most of them weak. In a simulator a crash is no harm; on a machine begin with
# policies that you trust.
initial = problem.initial_trials(20, seed=0)
optimizer = HdSafeBOLocal(problem, alpha=0.95, seed=0)
optimizer.observe(initial.x, initial.objective, initial.safety, status=initial.status, initial=True)
print(
    f"initial policies: {100 * optimizer.feasible.mean():.0f} % safe, best return {optimizer.best().objective:.1f}"
)

# %% Rounds of five.
for number in range(1, 9):
    trials = optimizer.ask(5)
    results = problem.evaluate(trials)
    optimizer.tell(trials, results.objective, results.safety, status=results.status())
    if number % 4 == 0:
        asked = ~optimizer.trials.initial
        print(
            f"{asked.sum()} trials: {100 * optimizer.feasible[asked].mean():.0f} % safe, "
            f"best return {optimizer.best().objective:.1f}"
        )

# %% The best policy with seeds that no trial met, and a file to keep.
best = optimizer.best()
unseen = problem.play(best.x, seeds=(1001, 1002, 1003))
print("returns with other seeds:", [round(episode.total_reward, 1) for episode in unseen])
problem.save_policy(best.x, "cart.safetensors")

# %% picture: Left, return of every trial over the cart's least distance from the wall: initial policies are hollow, and the search moves to high returns on the safe side. Right, the cart's position during episodes of the best policy with three other seeds, which passes the mark at 1.0 and stays below the wall until the episode ends.
from matplotlib.figure import Figure

figure = Figure(figsize=(6.6, 3.2), layout="constrained", dpi=150)
left, right = figure.subplots(1, 2)
trials = optimizer.trials
for which, face in ((trials.initial, "white"), (~trials.initial, "#0072B2")):
    left.scatter(
        trials.safety[which, 0], trials.objective[which], s=20, facecolors=face, edgecolors="#0072B2"
    )
left.axvline(0.0, color="#D55E00")
left.set(xlabel="least distance from the wall", ylabel="return", title="hollow: initial policies")
for episode in unseen:
    right.plot(episode.observations[:, 0], color="#0072B2", linewidth=1)
right.axhline(1.2, color="#D55E00")
right.axhline(1.0, color="#9A9A9A", linestyle=":")
right.set(xlabel="step", ylabel="position", title="the best policy, other seeds")
