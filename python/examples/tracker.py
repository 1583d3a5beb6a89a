"""Zhang, Wang, Zhang (2018): a new weighting algorithm, on the two-axis tracker.

Four Kalman filters with different scales of the transition matrix; the third is right.
Which law of the weights finds it, and how fast?
"""

# %% Case 1 of section 5, 400 trials of 200 steps.
from pathlib import Path

import matplotlib.pyplot as plt
import pymmae
from pymmae import plot

FILE = Path(__file__).resolve().parents[2] / "examples" / "tracker_case1.toml"
case = pymmae.Scenario.load(FILE).updated({"run": {"trials": 400, "every": 10}})

# %% Bayes's posterior and the two algorithms of the paper on the same random numbers.
laws = {"bayes": 0.999, "zhang1": 0.973, "zhang2": 0.999}
found = {}
for law, expected in laws.items():
    summary = pymmae.monte_carlo(case.updated({"weighting": {"law": law}}))
    found[law] = summary
    share = float(summary.identified.isel(time=-1, model=2))
    print(f"{law}: the truth has the largest weight in {share:.3f} of the trials")
    assert abs(share - expected) < 0.05

# %% Filters that are right are consistent: the normalised innovation squared is in its band.
bayes = found["bayes"]
low, high = bayes.attrs["nis_band"]
inside = (bayes.nis.isel(model=2) > low) & (bayes.nis.isel(model=2) < high)
assert float(inside.mean()) > 0.8

# %% One trial, state by state.
course = pymmae.run(case, seed=7)
figure, axes = plt.subplots(2, 1, figsize=(7, 7), layout="constrained")
plot.weights(found["bayes"], axes[0])
plot.errors(found["bayes"], axes[1])
figure.savefig("tracker.png", dpi=100)
plot.states(course)[0].figure.savefig("tracker_states.png", dpi=100)
