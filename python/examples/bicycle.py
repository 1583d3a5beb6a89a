"""Liu, Peng: states and parameters of a bicycle model, the grip of the front tyres unknown.

The cornering stiffness of the front tyres is to be identified from the yaw rate while the
driver steers. The sets tell what can be known; here they answer for a second speed too.
"""

# %% The scenario of the crate: four nominal stiffnesses, from a wet to a dry road.
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pymmae
from pymmae import plot

FILE = Path(__file__).resolve().parents[2] / "examples" / "bicycle.toml"
car = pymmae.Scenario.load(FILE, units={"Cf": "N/rad", "v_y": "m/s", "r": "rad/s"})
sets = pymmae.eip(car)
print(dict(zip(sets.label.values, sets.nominal.values[:, 0])))

# %% Every nominal plant is identified as itself, and boundaries lie between neighbours.
for i in range(4):
    assert int(sets.winner.sel(Cf=float(sets.nominal[i, 0]), method="nearest")) == i
nominal = sets.nominal.values[:, 0]
assert ((sets.boundary > nominal[:-1]) & (sets.boundary < nominal[1:])).all()

# %% The plants as matrices: the same family from a function, evaluated once over the grid.
p = car.parameters


def lateral(Cf: float) -> dict[str, object]:
    a, b, m, Iz, vx, Cr = (p[name] for name in ("a", "b", "m", "Iz", "vx", "Cr"))
    return {
        "A": [
            [-2 * (Cf + Cr) / (m * vx), 2 * (b * Cr - a * Cf) / (m * vx) - vx],
            [2 * (b * Cr - a * Cf) / (Iz * vx), -2 * (a**2 * Cf + b**2 * Cr) / (Iz * vx)],
        ],
        "B": [[2 * Cf / m], [2 * a * Cf / Iz]],
        "G": [[2 * Cf / m], [2 * a * Cf / Iz]],
        "C": [[0, 1]],
        "Q": [[(0.1 * np.pi / 180) ** 2 * 0.01]],
        "R": [[0.005**2 * 0.01]],
    }


family = pymmae.Family.from_function(
    lateral, {"Cf": sets.Cf.values}, models={"Cf": nominal}, outputs=["r"], inputs=["steer"]
)
tables = car.tables
del tables["plant"]
same = pymmae.eip(pymmae.Scenario(tables, family=family))
assert (same.winner.values == sets.winner.values).all()
assert np.allclose(same.boundary, sets.boundary, rtol=1e-9)

# %% At twice the speed the boundaries move: what is identified depends on the speed.
fast = pymmae.eip(car.updated({"plant": {"parameters": {"vx": 30}}}))
print(sets.boundary.values, fast.boundary.values)

figure, (above, below) = plt.subplots(2, 1, figsize=(7, 8), layout="constrained")
plot.eip(sets, above)
plot.eip(fast, below)
below.set_title("at 30 m/s")
figure.savefig("bicycle.png", dpi=100)
