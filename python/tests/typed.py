"""What mypy --strict makes of the interface."""

from __future__ import annotations

import numpy as np
import pymmae
import xarray as xr
from numpy.typing import NDArray

A: NDArray[np.float64] = -np.eye(2)
solutions: pymmae.Solutions = pymmae.lyap(A, np.eye(2), threads=2)
X: NDArray[np.float64] = solutions.X
first: pymmae.Error | None = next(iter(solutions.errors.values()), None)

scenario = pymmae.Scenario({"plant": {"family": "pendulum"}}, units={"L": "m"})
names: tuple[str, ...] = scenario.states


def tell(done: int, total: int) -> None:
    print(done, total)


def study() -> xr.Dataset:
    sets: xr.Dataset = pymmae.eip(scenario, progress=tell)
    placed: pymmae.Placement = pymmae.place("study.toml", cells=4)
    edges: NDArray[np.float64] = placed.edges
    assert len(edges) == 3
    return sets


def trials() -> float:
    summary = pymmae.monte_carlo(scenario, trials=10, truth={"L": 1.2})
    course = pymmae.estimate(scenario, np.zeros((3, 2)))
    return float(summary.p[-1, 0]) + float(course.p[-1, 0])


def observer() -> float:
    found: xr.Dataset = pymmae.adaptive(scenario, trials=3, truth={"a": 1.0}, progress=True)
    grid = pymmae.adaptive("motor.toml", A, [[0.0]], K=A[:, None], forgetting=[0.1, 0.2], t=A[0])
    uneven: xr.Dataset = pymmae.estimate(scenario, A, t=np.arange(2))
    assert uneven.sizes["time"] == 2 and grid.sizes["item"] == 2
    return float(found.theta_hat[0, -1, 0])


try:
    study()
except pymmae.ScenarioError as error:
    places: list[int] = [d["line"] for d in error.diagnostics]
