"""Aguiar, Athans, Pascoal (2007): convergence of a continuous-time estimator.

An oscillator of unknown natural frequency and four Kalman-Bucy filters. Under white noise
the likelihood picks the model that is nearest in information, in every trial.
"""

# %% The scenario of the crate, section V of the paper.
from pathlib import Path

import matplotlib.pyplot as plt
import pymmae
from pymmae import plot

FILE = Path(__file__).resolve().parents[2] / "examples" / "oscillator_likelihood.toml"
bank = pymmae.Scenario.load(FILE, units={"wn": "rad/s", "x": "m", "x_dot": "m/s", "force": "N"})
bank = bank.updated({"run": {"duration": 100, "trials": 10, "every": 250}})

# %% Three plants: a nominal value, and two between nominal values.
figure, axes = plt.subplots(3, 1, figsize=(7, 8), layout="constrained", sharex=True)
for wn, nearest, ax in zip([0.7, 1.2, 2.7], [0.7, 1.0, 4.0], axes):
    summary = pymmae.monte_carlo(bank, truth={"wn": wn})
    model = int(summary.p.isel(time=-1).argmax("model"))
    print(f"wn = {wn}: identified as {float(summary.nominal[model, 0])}")
    assert float(summary.nominal[model, 0]) == nearest
    assert (abs(summary.p.sum("model") - 1) < 1e-12).all()
    plot.weights(summary, ax)
    ax.set_title(f"natural frequency {wn} rad/s")

# %% The sets of plants say it beforehand: 1.2 belongs to 1.0, 2.7 to 4.0.
sets = pymmae.eip(
    bank.updated({"eip": {"grid": {"wn": {"from": 0.5, "to": 5.0, "points": 91, "scale": "log"}}}})
)
for wn, nearest in [(0.7, 0.7), (1.2, 1.0), (2.7, 4.0)]:
    winner = int(sets.winner.sel(wn=wn, method="nearest"))
    assert float(sets.nominal[winner, 0]) == nearest

figure.savefig("oscillator.png", dpi=100)
