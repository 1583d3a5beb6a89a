"""Hassani, Aguiar, Pascoal, Athans (2009): sets of equivalently identified plants.

An inverted pendulum of unknown length is watched by four observers, each designed for a
nominal length. Which of them is each plant identified as?
"""

# %% The scenario of the crate: plant, controller, coloured disturbance, models, grid.
from pathlib import Path

import numpy as np
import pymmae
from pymmae import plot

FILE = Path(__file__).resolve().parents[2] / "examples" / "pendulum.toml"
study = pymmae.Scenario.load(FILE, units={"L": "m", "x": "m", "theta": "rad"})

# %% The sets, and where they meet. The paper reads its boundaries off a figure.
sets = pymmae.eip(study)
print(sets.boundary.values)
assert np.allclose(sets.boundary[0], 1.153616065, atol=1e-9)
assert (np.diff(sets.boundary) > 0).all()

# %% A plant of 1.2 m is identified as the second model, although 1.025 is nearer than 1.526.
winner = int(sets.winner.sel(L=1.2, method="nearest"))
assert float(sets.nominal[winner, 0]) == 1.287

# %% The pseudo-norm between models tells how different their residuals are (21).
print(sets.pseudo_norm.to_pandas())
assert (np.diag(sets.pseudo_norm) == 0).all()

# %% Better nominal values: four equal cells.
placed = pymmae.place(study, cells=4)
better = pymmae.eip(study.updated({"bank": {"models": {"L": placed.nominals}}}))
assert np.allclose(better.boundary, [1.15, 1.4, 1.65], atol=1e-8)

# %% Sets before and after.
import matplotlib.pyplot as plt  # noqa: E402

figure, (above, below) = plt.subplots(2, 1, figsize=(7, 8), layout="constrained")
plot.eip(sets, above)
plot.eip(better, below)
below.set_title("Nominal values placed for four equal cells")
figure.savefig("pendulum.png", dpi=100)
