"""Scenarios, families and labelled results."""

from __future__ import annotations

import copy
import hashlib
import json
import subprocess

import numpy as np
import pymmae
import pytest
import xarray as xr
from conftest import EXAMPLES, SMALL

PENDULUM = EXAMPLES / "pendulum.toml"


@pytest.fixture(scope="module")
def pendulum() -> xr.Dataset:
    return pymmae.eip(PENDULUM)


def test_the_pendulum_of_the_paper(pendulum):
    assert dict(pendulum.upsilon.sizes) == {"L": 401, "model": 4}
    assert pendulum.upsilon.attrs["units"] == "1/s"
    np.testing.assert_allclose(pendulum.boundary[0], 1.153616065, atol=1e-9)
    assert int(pendulum.winner.sel(L=1.2, method="nearest")) == 1
    assert pendulum.attrs["title"] == "Inverted pendulum, length unknown"
    assert float(pendulum.nominal.sel(parameter="L")[2]) == 1.526


def test_bytes_are_those_of_the_command(command, pendulum, tmp_path):
    arguments = [command, "eip", PENDULUM, "--out", tmp_path / "out"]
    subprocess.run(arguments, check=True, capture_output=True)
    written = (tmp_path / "out" / "eip.json").read_bytes()
    assert hashlib.sha256(written).hexdigest() == pendulum.attrs["sha256"]
    upsilon = np.array(json.loads(written)["upsilon"], dtype=float)
    assert (upsilon == pendulum.upsilon.values).all()


def test_trials_are_those_of_the_command(command):
    path = EXAMPLES / "tracker_case1.toml"
    arguments = [command, "run", path, "--trials", "200", "--json"]
    told = json.loads(subprocess.run(arguments, check=True, capture_output=True).stdout)
    got = pymmae.monte_carlo(path, trials=200, threads=2)
    assert got.p.values[-1].tolist() == told["p"]
    assert got.identified.values[-1].tolist() == told["identified"]
    assert float(got.x_error_rms[-1]) == told["x_error_rms"]
    assert got.time.values.tolist() == [row["t"] for row in told["record"]]
    np.testing.assert_allclose(got.theta_hat[-1], told["theta_hat"], rtol=1e-15)


def test_the_estimate_is_that_of_the_command(command):
    path, data = EXAMPLES / "nile.toml", EXAMPLES / "nile.csv"
    flow = np.loadtxt(data, delimiter=",", skiprows=1)[:, 1]
    arguments = [command, "estimate", path, "--data", data, "--json"]
    told = json.loads(subprocess.run(arguments, check=True, capture_output=True).stdout)
    got = pymmae.estimate(path, flow[:, None])
    assert got.p.values[-1].tolist() == told["p"]
    assert got.log_lik_models.values.tolist() == told["loglik"]
    assert got.x_hat.values[-1].tolist() == told["x_hat"]
    many = pymmae.estimate(path, np.stack([flow, flow[::-1]])[:, :, None], threads=2)
    assert many.log_p.values[0, -1].tolist() == got.log_p.values[-1].tolist()


def test_inputs_act_from_their_row_on():
    """A row's input moves the state between its measurement and the next."""
    tables = copy.deepcopy(SMALL)
    tables["plant"] |= {"inputs": ["u"], "B": 1, "Q": 1e-12, "R": 1e-6, "A": "a"}
    tables["bank"] |= {"x0": [0.0], "P0": 0}
    u = np.array([[1.0], [0.0], [-1.0], [2.0], [0.5]])
    x, seen = 0.0, []
    for k in range(5):
        x = 0.8 * x + (u[k - 1, 0] if k else 0.0)
        seen.append(x)
    got = pymmae.estimate(tables, np.array(seen)[:, None], u)
    np.testing.assert_allclose(got.r.values[:, 1, 0], 0.0, atol=1e-12)


def test_threads_change_no_bit():
    for call in (pymmae.eip, pymmae.monte_carlo):
        assert call(SMALL, threads=1).identical(call(SMALL, threads=2))


def test_courses_of_trials():
    course = pymmae.run(SMALL, trials=3, every=2)
    want = {"trial": 3, "time": 4, "state": 1, "output": 1, "model": 2}
    assert {dim: course.sizes[dim] for dim in want} == want
    assert course.time.values.tolist() == [1.0, 2.0, 3.0, 4.0]
    again = pymmae.run(SMALL, trials=1, every=2)
    assert (again.x.values == course.x.values[:1]).all()  # a trial is the same in any company
    assert (course.theta.values == 0.8).all()


def test_two_parameters_and_delays():
    grid = pymmae.eip(EXAMPLES / "two_parameters.toml")
    assert grid.winner.dims == ("k", "c") and grid.winner.shape == (61, 41)
    delays = pymmae.eip(EXAMPLES / "pendulum_delay.toml")
    assert delays.upsilon.dims == ("delay", "L", "model")
    assert delays.sizes["undecidable"] > 0


def test_names_of_parameters_that_a_dataset_uses_itself():
    tables = copy.deepcopy(SMALL)
    tables["plant"] |= {"A": "model", "parameters": {"model": 0.5}}
    tables["bank"] = {"models": {"model": [0.3, 0.8]}}
    tables["eip"] = {"grid": {"model": [0.4, 0.9]}}
    del tables["truth"]
    assert "plant_model" in pymmae.eip(tables).dims


@pytest.mark.parametrize("make", [pymmae.eip, pymmae.monte_carlo, pymmae.run])
def test_datasets_go_to_files_and_tables(make, tmp_path):
    result = make(pymmae.Scenario(SMALL, units={"x": "m", "a": "1"}))
    result.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as again:
        assert_equal(result, again)
    result.to_zarr(tmp_path / "result.zarr", zarr_format=2, consolidated=False)
    assert_equal(result, xr.open_zarr(tmp_path / "result.zarr", consolidated=False))
    frame = result["log_p" if "log_p" in result else "upsilon"].to_dataframe()
    assert len(frame) > 0


def assert_equal(result: xr.Dataset, again: xr.Dataset) -> None:
    assert set(again.variables) == set(result.variables)
    for name in result.variables:
        one, other = result[name].values, again[name].values
        if one.dtype.kind in "USO":
            assert one.astype(str).tolist() == other.astype(str).tolist(), name
        else:
            np.testing.assert_array_equal(one, other, err_msg=name)
    for key in ("version", "law", "sha256"):
        assert again.attrs.get(key) == result.attrs.get(key)


def spring(k: float) -> dict[str, object]:
    return {"A": [[0, 1], [-k, -0.3]], "G": [[0], [1]], "C": [[1, 0]], "Q": [[1]], "R": [[0.01]]}


STUDY = {
    "bank": {"models": {"k": [0.6, 1.0, 1.7]}},
    "eip": {"grid": {"k": {"from": 0.5, "to": 2.0, "points": 151}}},
}
WRITTEN = {
    "plant": {
        "time": "continuous",
        "states": ["x1", "x2"],
        "outputs": ["y1"],
        "disturbances": ["w1"],
        "A": [[0, 1], ["-k", -0.3]],
        "G": [0, 1],
        "C": [1, 0],
        "Q": 1,
        "R": 0.01,
        "parameters": {"k": 1.0},
    },
    **STUDY,
}


def test_a_family_from_expressions_matrices_and_a_function_is_the_same():
    written = pymmae.eip(WRITTEN)
    grid = written.k.values
    calls = []

    def counted(k):
        calls.append(k)
        return spring(k)

    made = pymmae.Family.from_function(counted, {"k": grid}, models={"k": [0.6, 1.0, 1.7]})
    assert len(calls) == len(made.axes["k"]) == len(set(calls))
    function = pymmae.eip(pymmae.Scenario(STUDY, family=made))
    matrices = {letter: m for letter, m in made.matrices.items() if letter != "B"}
    stacked = pymmae.Family.from_stacked(made.axes, **matrices)
    stacked = pymmae.eip(pymmae.Scenario(STUDY, family=stacked))
    for other in (function, stacked):
        assert (other.upsilon.values == written.upsilon.values).all()
        assert (other.winner.values == written.winner.values).all()
    # A is linear in k: so are the plants in between
    np.testing.assert_allclose(function.boundary, written.boundary, rtol=1e-9)


def test_boundaries_of_an_interpolated_family_come_nearer_with_the_square():
    def curved(k):
        return spring(k**2)

    tables = copy.deepcopy(WRITTEN)
    tables["plant"]["A"][1][0] = "-k^2"
    want = pymmae.eip(tables).boundary.values
    errors = []
    for points in (13, 25):
        axes = {"k": np.linspace(0.5, 2.0, points)}
        family = pymmae.Family.from_function(curved, axes, models={"k": [0.6, 1.0, 1.7]})
        got = pymmae.eip(pymmae.Scenario(STUDY, family=family)).boundary.values
        errors.append(np.abs(got - want).max())
    assert errors[1] < 0.5 * errors[0] and errors[1] < 1e-2


def test_two_parameters_by_a_function_and_trials_on_it():
    def plant(k, c):
        return {**spring(k), "A": [[0, 1], [-k, -c]]}

    axes = {"k": [0.5, 1.0, 2.0], "c": [0.2, 0.4]}
    family = pymmae.Family.from_function(plant, axes, states=["x", "v"])
    tables = {
        "bank": {"models": {"k": [0.5, 2.0], "c": [0.2, 0.4]}, "dt": 0.1},
        "eip": {"grid": axes},
        "truth": {"parameters": {"k": 0.5, "c": 0.2}},
        "run": {"steps": 20},
    }
    scenario = pymmae.Scenario(tables, family=family)
    assert pymmae.eip(scenario).winner.shape == (3, 2)
    assert pymmae.run(scenario).state.values.tolist() == ["x", "v"]
    np.testing.assert_allclose(scenario.plant(k=1.5, c=0.3)["A"], [[0, 1], [-1.5, -0.3]])
    with pytest.raises(pymmae.InputError, match="k = 3"):
        scenario.plant(k=3.0)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"A": np.zeros((3, 2, 2))}, "A has shape"),
        ({"states": ["a"]}, "states"),
        ({"states": ["a", "a"]}, "states"),
        ({"nominal": {"z": 1}}, "nominal"),
        ({"axes": {"k": [2.0, 1.0]}}, "axis of k"),
        ({"axes": {}}, "axes"),
        ({"C": [1.0, 0.0]}, "C"),
    ],
)
def test_families_that_are_wrong(change, word):
    arguments = {"axes": {"k": [1.0, 2.0]}, "A": np.zeros((2, 2, 2)), "C": [[1, 0]], "R": [[1]]}
    with pytest.raises(pymmae.InputError, match=word):
        pymmae.Scenario(STUDY, family=pymmae.Family.from_stacked(**{**arguments, **change}))


def test_placement():
    tables = pymmae.Scenario.load(PENDULUM).updated({"eip": {"grid": {"L": {"points": 41}}}})
    placed = pymmae.place(tables, 4)
    np.testing.assert_allclose(placed.edges, [1.15, 1.4, 1.65], atol=1e-9)
    sets = pymmae.eip(tables.updated({"bank": {"models": {"L": placed.nominals}}}))
    np.testing.assert_allclose(sets.boundary, placed.edges, atol=1e-8)
    with pytest.raises(pymmae.InputError, match="one of"):
        pymmae.place(tables, 4, excess=0.1)
