"""Liu, Peng: a state and parameter identification scheme, examples 4.1 and 4.2.

Parameters that enter a plant linearly are estimated together with its states, from one
measured output. An adaptive observer estimates the values themselves; a bank asks which of a
few candidates is right.
"""

# %% Example 4.1: four parameters of a nonlinear plant, one of its two states measured.
from pathlib import Path

import numpy as np
import pymmae
from pymmae import plot

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
nonlinear = pymmae.Scenario.load(EXAMPLES / "adaptive_nonlinear.toml", units={"y": "m"})
found = pymmae.adaptive(nonlinear, every=20).isel(trial=0)
end = found.isel(time=-1)
print(end.theta_hat.to_series(), end.theta_std.to_series(), sep="\n")
assert float(abs(end.theta_hat / end.theta - 1).max()) < 1e-2
assert abs(float(end.x_hat.sel(state="x2") - end.x.sel(state="x2"))) < 1e-3

# %% After a minute it is not there yet: numbers of an independent integration.
minute = found.theta_hat.sel(time=60, method="nearest")
want = [2.9240183493, -2.8782013488, 4.3767295453, -3.7132487472]
assert np.allclose(minute, want, atol=2e-3)

# %% The output tells all four apart, and the excitation of a window is told as well.
assert int(found["rank"]) == 4
print(f"condition of the excitation {float(end.condition):.0f}, settled: {bool(end.settled)}")

# %% Forgetting and gain, a grid of six observers on the same noisy record. One that forgets
# slowly has not come near after 80 s; one that forgets fast lets the noise through.
noisy = nonlinear.updated({"adaptive": {"truth": {"noise": {"y": 0.02}}}})
one = pymmae.adaptive(noisy, every=1, trials=1).isel(trial=0)
u = sum(a * np.sin(w * one.time.values) for a, w in [(1.1, 0.3), (1.2, 1.0), (1.0, 1.5)])
rates = np.array([0.02, 0.15, 0.6])
gains = np.array([[[5.0], [-5.0]], [[11.0], [31.0]]])
grid = pymmae.adaptive(
    noisy,
    one.y.values,
    u[:, None],
    forgetting=np.tile(rates, 2),
    K=np.repeat(gains, 3, axis=0),
    every=20,
)
error = abs(grid.theta_hat - one.theta).max("parameter").sel(time=slice(80, None)).mean("time")
table = error.assign_coords(gain=("item", np.repeat([1, 2], 3))).set_index(
    item=["gain", "forgetting"]
)
print(table.unstack("item").to_pandas())
assert (table.unstack("item").argmin("forgetting") == 1).all()

# %% The sign of the gain as printed in the paper makes the observer unstable: it says so.
wrong = pymmae.adaptive(noisy, one.y.values, u[:, None], K=[[[5.0], [-5.0]], [[-5.0], [5.0]]])
print(wrong.failure.values[1])
assert "turn the sign of K" in str(wrong.failure.values[1])

# %% Example 4.2: a vehicle from its yaw rate. As posed its parameters are not identifiable.
vehicle = pymmae.Scenario.load(EXAMPLES / "vehicle.toml", units={"r": "rad/s", "vx": "m/s"})
try:
    pymmae.adaptive(vehicle, observer="as_posed")
except pymmae.ScenarioError as error:
    print(error)
    assert error.code == "not_identifiable"

# %% In canonical form it is, and stiffness, inertia, and centre of gravity follow from it.
car = pymmae.adaptive(vehicle, case="perturbed").isel(trial=0)
print(car.phi_hat.to_series(), car.phi.to_series(), sep="\n")
assert np.allclose(car.phi_hat, car.phi, rtol=0.02)

# %% Estimates with two standard deviations, over the plant.
import matplotlib.pyplot as plt  # noqa: E402

figure, axes = plt.subplots(4, 1, figsize=(7, 8), sharex=True, layout="constrained")
plot.parameters(found, axes)
figure.savefig("adaptive.png", dpi=100)
plot.states(found)[0].figure.savefig("adaptive_states.png", dpi=100)
