"""Adaptive observers: against the command, reference numbers, and each other."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
import textwrap

import numpy as np
import pymmae
import pytest
import xarray as xr
from conftest import EXAMPLES, MOTOR, ROOT

NONLINEAR, VEHICLE = EXAMPLES / "adaptive_nonlinear.toml", EXAMPLES / "vehicle.toml"


def record(samples: int = 300, gain: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """What the motor does under ``u = gain sin 2 t``, from rest."""
    t = 0.02 * np.arange(samples)
    y = 2 / 5 * (np.sin(2 * t) - 2 * np.cos(2 * t) + 2 * np.exp(-t))
    return gain * y[:, None], gain * np.sin(2 * t)[:, None]


def told(command: str, *arguments: object) -> dict:
    done = subprocess.run(
        [command, *map(str, arguments), "--json"], check=True, capture_output=True
    )
    return json.loads(done.stdout)


def same(mine: object, theirs: object) -> None:
    """By bits; what is not a number is null in JSON."""
    theirs = np.array(theirs, dtype=float)
    np.testing.assert_array_equal(np.asarray(mine, dtype=float), theirs)


def test_a_run_is_that_of_the_command(command):
    want, got = told(command, "run", NONLINEAR)["observers"][0], pymmae.adaptive(NONLINEAR)
    one, end = got.isel(trial=0), got.isel(trial=0, time=-1)
    for name in ("theta_hat", "theta_std", "x_hat", "x_std", "x"):
        same(one[name], [row[name] for row in want["record"]])
    same(got.time, [row["t"] for row in want["record"]])
    same(end.correlation, want["correlation"])
    same(got.theta, want["theta"])
    same(end.at_bound, want["at_bound"])
    for mine, theirs in (("window", "t"), *((k, k) for k in ("condition", "residual", "drift"))):
        same(end[mine], want["window"][theirs])
    assert got.parameter.values.tolist() == want["parameters"]
    assert int(got.truth_steps) == want["truth_steps"]
    assert float(got.truth_error) == want["truth_error"]


def test_cases_trials_and_physical_parameters_are_those_of_the_command(command, tmp_path):
    short = pymmae.Scenario.load(VEHICLE).updated({"run": {"duration": 12, "every": 1000}})
    path = tmp_path / "short.toml"
    path.write_text(short.text)
    want = told(command, "run", path, "--trials", 3, "--seed", 5)
    got = pymmae.adaptive(short, trials=3, seed=5, threads=2)
    assert got.attrs["observer"] == want["observer"] == "canonical"
    assert got.case.values.tolist() == [o["case"] for o in want["observers"]]
    for k, case in enumerate(want["observers"]):
        mine = got.isel(case=k)
        end = mine.isel(time=-1)
        np.testing.assert_allclose(end.theta_hat.mean("trial"), case["theta_hat"], rtol=1e-14)
        spread = end.theta_hat.std("trial", ddof=1)
        np.testing.assert_allclose(spread, case["theta_spread"], rtol=1e-9, atol=1e-12)
        same(end.theta_std.isel(trial=0), case["theta_std"])
        quantiles = mine.theta_hat.quantile([0.05, 0.25, 0.5, 0.75, 0.95], "trial")
        wanted = [row["theta_quantiles"] for row in case["record"]]
        np.testing.assert_allclose(quantiles.transpose("time", "parameter", "quantile"), wanted)
        same(mine.phi, case["physical"]["truth"])
    one = told(command, "run", path)["observers"][0]["physical"]
    alone = pymmae.adaptive(short, case="perturbed")
    assert "case" not in alone.dims
    same(alone.phi_hat.isel(trial=0), one["value"])
    same(alone.phi_std.isel(trial=0), one["std"])
    assert alone.physical.values.tolist() == one["parameters"]


def test_a_record_is_that_of_the_command(command, tmp_path):
    """Uneven times, missing outputs."""
    y, u = record()
    t = 3.0 + 0.02 * np.arange(300)
    y[[17, 40, 41], 0] = np.nan
    kept = np.r_[0:100, 103:300]
    rows = ["" if np.isnan(v) else repr(float(v)) for v in y[kept, 0]]
    lines = [f"{a!r},{b!r},{c}" for a, b, c in zip(t[kept].tolist(), u[kept, 0].tolist(), rows)]
    (tmp_path / "record.csv").write_text("\n".join(["t,u,y", *lines]))
    scenario = pymmae.Scenario(MOTOR)
    (tmp_path / "motor.toml").write_text(scenario.text)
    arguments = ("estimate", tmp_path / "motor.toml", "--data", tmp_path / "record.csv")
    want = told(command, *arguments, "--every", 30)
    got = pymmae.adaptive(scenario, y[kept], u[kept], t=t[kept], every=30)
    told_rows = want["observers"][0]["record"]
    same(got.time[:-1], [row["t"] for row in told_rows])
    for name in ("theta_hat", "theta_std", "x_hat", "x_std"):
        same(got[name][:-1], [row[name] for row in told_rows])
    same(got.theta_hat[-1], want["theta_hat"])
    same(got.window[-1], want["observers"][0]["window"]["t"])
    assert got.attrs["samples"] == want["samples"] == 300


def test_a_gap_is_measurements_that_are_missing():
    y, u = record()
    u[:] = np.linspace(0, 1, 300)[:, None]  # straight, as between samples
    hole = y.copy()
    hole[100:103] = np.nan
    kept = np.r_[0:100, 103:300]
    gap = pymmae.adaptive(MOTOR, y[kept], u[kept], t=0.02 * kept)
    whole = pymmae.adaptive(MOTOR, hole, u)
    assert gap.time.values.tolist() == (0.02 * kept).tolist()
    np.testing.assert_allclose(gap.theta_hat, whole.theta_hat[kept], rtol=1e-9, atol=1e-9)


def test_numbers_of_the_reference():
    """tests/data/adaptive.json: sampled steps of example 4.1, explicit recursions."""
    case = json.loads((ROOT / "tests" / "data" / "adaptive.json").read_text())["sampled_order2"]
    tables = pymmae.Scenario.load(NONLINEAR).tables
    tables["adaptive"]["dt"] = case["h"]
    y, u = (np.array(case[key])[:, None] for key in ("y", "u"))
    got = pymmae.adaptive(tables, y, u, P0=case["P0"])
    assert len(case["values"]) == 8
    for k, want in case["values"].items():
        np.testing.assert_allclose(got.theta_hat[int(k)], want["theta"], rtol=1e-9)
        np.testing.assert_allclose(got.x_hat[int(k)], want["xhat"], rtol=1e-9, atol=1e-12)


def test_the_motor_is_identified():
    y, u = record(600)
    found = pymmae.adaptive(MOTOR, y, u)
    np.testing.assert_allclose(found.theta_hat[-1], [-1, 2], rtol=1e-3)
    assert bool(found.settled[-1]) and not bool(found.settled[10])
    assert (np.diagonal(found.correlation.values, 0, 1, 2) == 1).all()
    assert int(found["rank"]) == 2 and float(found.singular[0]) == 1.0
    bounded = copy.deepcopy(MOTOR)
    bounded["adaptive"]["observers"]["motor"]["theta"]["b"]["max"] = 1.5
    held = pymmae.adaptive(bounded, y, u).isel(time=-1)
    assert held.at_bound.values.tolist() == [False, True] and not bool(held.settled)


GAINS = np.array([0.5, 1.0, 2.0, -1.0, 4.0, 8.0, 16.0, 3.0, 5.0, np.nan])[:, None, None]


def test_a_grid_is_each_observer_alone_and_bad_items_are_flagged():
    y, u = record()
    lambdas = np.linspace(0, 0.9, 10)
    starts = np.stack([np.zeros(10), np.linspace(0, 1, 10)], axis=1)
    options = dict(every=100, P0=1e5)
    grid = pymmae.adaptive(MOTOR, y, u, K=GAINS, forgetting=lambdas, theta0=starts, **options)
    assert dict(grid.theta_hat.sizes) == {"item": 10, "time": 3, "parameter": 2}
    assert grid.forgetting.values.tolist() == lambdas.tolist()
    for i in range(10):
        one = dict(K=GAINS[i], forgetting=lambdas[i], theta0=starts[i], **options)
        mine = grid.isel(item=i)
        if i in (3, 9):
            word = "does not decay" if i == 3 else "K"
            assert word in str(mine.failure.values) and mine.theta_hat.isnull().all()
            with pytest.raises(pymmae.InputError, match=word):
                pymmae.adaptive(MOTOR, y, u, **one)
        else:
            assert str(mine.failure.values) == ""
            alone = pymmae.adaptive(MOTOR, y, u, **one)
            assert alone.identical(mine.reset_coords("forgetting").drop_vars("item"))
    rate = pymmae.adaptive(MOTOR, y, u, forgetting=lambdas[:3])
    assert dict(rate.K.sizes) == {"item": 3, "state": 1, "output": 1} and (rate.K == 2).all()
    # two dimensions of a grid are the reader's
    stacked = rate.assign_coords(half=("item", [0, 0, 1]), which=("item", [0, 1, 0]))
    assert stacked.set_index(item=["half", "which"]).unstack("item").sizes["half"] == 2


def test_many_records_are_each_alone():
    signals = [record(120, gain) for gain in (1.0, 2.0, 0.5)]
    y, u = (np.stack([pair[k] for pair in signals]) for k in (0, 1))
    y[1, 50:60] = np.nan
    many = pymmae.adaptive(MOTOR, y, u, every=40)
    assert dict(many.x_hat.sizes) == {"record": 3, "time": 3, "state": 1}
    for k in range(3):
        alone = pymmae.adaptive(MOTOR, y[k], u[k], every=40)
        assert alone.identical(many.isel(record=k).drop_vars("record"))
    shared = pymmae.adaptive(MOTOR, y, u[0], every=0)
    alone = pymmae.adaptive(MOTOR, y[2], u[0], every=0)
    same(shared.theta_hat[2], alone.theta_hat)
    both = pymmae.adaptive(MOTOR, y, u, forgetting=[0.0, 0.2])
    assert both.theta_hat.dims == ("item", "record", "time", "parameter")
    assert both.y.dims == ("record", "time", "output")


def test_trials_are_the_same_in_any_company():
    all_ = pymmae.adaptive(MOTOR, trials=20, forgetting=[0.0, 0.1, 0.3])
    few = pymmae.adaptive(MOTOR, trials=2, forgetting=0.1)
    assert few.theta_hat.dims == ("trial", "time", "parameter")
    for name in ("theta_hat", "theta_std", "y", "drift"):
        wide = all_[name].isel(trial=slice(2))
        same(few[name], wide.isel(item=1) if "item" in wide.dims else wide)
    # every item sees the same noise
    assert all_.y.dims == ("trial", "time", "output")
    changed = pymmae.adaptive(MOTOR, truth={"b": 3.0}, trials=1)
    assert changed.theta.values.tolist() == [-1, 3]
    np.testing.assert_allclose(changed.theta_hat[0, -1], [-1, 3], rtol=0.05)


def test_threads_change_no_bit():
    y, u = record(100)
    for call in (
        lambda n: pymmae.adaptive(MOTOR, trials=30, K=GAINS[:3], threads=n),
        lambda n: pymmae.adaptive(MOTOR, np.stack([y] * 20), u, K=GAINS, threads=n),
    ):
        assert call(1).identical(call(2))


@pytest.mark.parametrize("form", ["run", "record", "vehicle"])
def test_datasets_go_to_files_and_pickle(form, tmp_path):
    y, u = record(60)
    result = {
        "run": lambda: pymmae.adaptive(pymmae.Scenario(MOTOR, units={"x": "rad/s", "a": "1/s"})),
        "record": lambda: pymmae.adaptive(MOTOR, y, u, K=GAINS, every=20),
        "vehicle": lambda: pymmae.adaptive(VEHICLE, trials=1, case="noise_of_r", every=0),
    }[form]()
    assert pickle.loads(pickle.dumps(result)).identical(result)
    result.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    result.to_zarr(tmp_path / "result.zarr", zarr_format=2, consolidated=False)
    with xr.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as again:
        both = [again.load(), xr.open_zarr(tmp_path / "result.zarr", consolidated=False).load()]
    for again in both:
        assert set(again.variables) == set(result.variables)
        for name in result.variables:
            mine, theirs = result[name].values, again[name].values
            text = mine.dtype.kind == "U"
            np.testing.assert_array_equal(mine, theirs.astype(str) if text else theirs, name)
    assert both[0].attrs["observer"] == result.attrs["observer"]
    assert len(result.theta_hat.to_dataframe()) == result.theta_hat.size
    for name, variable in result.data_vars.items():
        assert "long_name" in variable.attrs, name
        assert "units" in variable.attrs or variable.dtype.kind == "U", name
    if form == "run":
        assert result.state_units.values.tolist() == ["rad/s"]
        assert result.parameter_units.values.tolist() == ["1/s", ""]


def test_an_observer_that_cannot_be_used_says_why():
    with pytest.raises(pymmae.ScenarioError, match="leaves y unchanged") as caught:
        pymmae.adaptive(VEHICLE, observer="as_posed")
    assert caught.value.code == "not_identifiable"
    assert caught.value.diagnostics[0]["key"] == "adaptive.observers.as_posed.theta"
    assert pymmae.Scenario.load(VEHICLE).observers == ("canonical", "as_posed")
    # one that is passed over is told
    tables = pymmae.Scenario.load(VEHICLE).tables
    observers = tables["adaptive"]["observers"]
    tables["adaptive"]["observers"] = {k: observers[k] for k in ("as_posed", "canonical")}
    with pytest.warns(pymmae.ScenarioWarning, match="as_posed cannot be used"):
        got = pymmae.adaptive(tables, case="nominal", trials=1, every=0)
    assert got.attrs["observer"] == "canonical"


def test_what_runs_away_is_flagged_or_raised():
    y, u = record(100)
    far = y * 1e200
    with pytest.raises(pymmae.NumericalError, match="ran away"):
        pymmae.adaptive(MOTOR, far, u)
    both = pymmae.adaptive(MOTOR, np.stack([y, far]), u)
    assert ["ran away" in str(text) for text in both.failure.values] == [False, True]
    same(both.theta_hat[0], pymmae.adaptive(MOTOR, y, u).theta_hat)
    with pytest.raises(pymmae.NumericalError) as caught:
        pymmae.adaptive(MOTOR, y, u, K=[[[-1.0]], [[-2.0]]])
    assert caught.value.code == "all_failed"


Y, U = record(20)
ABUSE = [
    ({"y": Y[:, 0]}, ValueError, "^y"),
    ({"y": np.c_[Y, Y]}, ValueError, "^y has 2 outputs"),
    ({"y": Y * 1j}, TypeError, "^y"),
    ({"y": Y.astype(">f8")}, TypeError, "^y"),
    ({"y": np.where(Y > 0.1, np.inf, Y)}, ValueError, "y of record 0"),
    ({"u": U[1:]}, ValueError, "^u has shape"),
    ({"u": np.where(U > 0.1, np.nan, U)}, ValueError, "u of record 0"),
    ({"t": np.arange(3.0)}, ValueError, "^t has shape"),
    ({"t": np.r_[0.0, 0.0, 1:19]}, ValueError, r"^t\[1\]: times must increase"),
    ({"t": np.full(20, np.nan)}, ValueError, r"^t\[0\]"),
    ({"t": 0.03 * np.arange(20)}, ValueError, r"^t\[1\]: .*multiple of dt"),
    ({"K": np.ones((2, 2))}, ValueError, "^K has shape"),
    ({"K": "high"}, TypeError, "^K"),
    ({"K": None, "forgetting": -1.0}, ValueError, "lambda"),
    ({"forgetting": [[0.1]]}, ValueError, "^forgetting has shape"),
    ({"forgetting": np.float64("nan")}, ValueError, "lambda"),
    ({"forgetting": [0.1, 0.2], "P0": [1.0, 2.0, 3.0]}, ValueError, "items"),
    ({"P0": 0.0}, ValueError, r"P\(0\)"),
    ({"P0": []}, ValueError, "^P0 is empty"),
    ({"theta0": [1.0]}, ValueError, "^theta0 has shape"),
    ({"theta0": [1.0, np.inf]}, ValueError, "theta"),
    ({"tolerance": -1.0}, ValueError, "tolerance"),
    ({"observer": "engine"}, ValueError, "^observer: .*has motor"),
    ({"trials": 3}, ValueError, "^trials has no meaning"),
    ({"seed": 3}, ValueError, "^seed has no meaning"),
    ({"truth": {"a": 1}}, ValueError, "^truth has no meaning"),
    ({"case": "truth"}, ValueError, "^case has no meaning"),
    ({"y": None}, ValueError, "^u has no meaning"),
    ({"y": None, "u": None, "case": "no"}, ValueError, "^case: .*has truth"),
    ({"y": None, "u": None, "truth": {"q": 1}}, ValueError, "no parameter 'q'"),
    ({"y": None, "u": None, "trials": 0}, ValueError, "trial"),
    ({"y": None, "u": None, "trials": 10**9}, MemoryError, "report less often"),
    ({"y": np.broadcast_to(Y, (2**19, 20, 1))}, MemoryError, "report less often"),
]


@pytest.mark.parametrize(("change", "error", "word"), ABUSE)
def test_refused_by_name(change, error, word):
    arguments = {"y": Y, "u": U, **change}
    with pytest.raises(error, match=word) as caught:
        pymmae.adaptive(MOTOR, **arguments)
    assert isinstance(caught.value, pymmae.Error)


def test_scenarios_without_what_is_needed():
    with pytest.raises(pymmae.ScenarioError, match="adaptive"):
        pymmae.adaptive({"plant": {"family": "pendulum"}})
    tables = copy.deepcopy(MOTOR)
    del tables["adaptive"]["truth"]
    del tables["adaptive"]["observers"]["motor"]["theta"]["a"]["truth"]
    del tables["adaptive"]["observers"]["motor"]["theta"]["b"]["truth"]
    with pytest.raises(pymmae.ScenarioError, match="truth"):
        pymmae.adaptive(tables)
    assert "theta" not in pymmae.adaptive(tables, Y, U)


def test_arguments_stay_as_they_are():
    y, u, k = Y.copy(), U.astype(np.float32), np.asfortranarray(GAINS[:2])
    before = [a.copy() for a in (y, u, k)]
    pymmae.adaptive(MOTOR, y, u, K=k)
    assert all((a == b).all() for a, b in zip(before, (y, u, k)))


def test_ctrl_c_stops_a_grid():
    code = f"""
    import os, signal, threading
    import numpy as np, pymmae
    signal.signal(signal.SIGINT, signal.default_int_handler)
    motor = {MOTOR!r}
    y, u = np.zeros((2, 4_000_000, 1))
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        pymmae.adaptive(motor, y, u, forgetting=np.linspace(0, 1, 64), every=0)
    except KeyboardInterrupt:
        print("stopped")
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120
    )
    assert done.stdout == "stopped\n", done.stderr
