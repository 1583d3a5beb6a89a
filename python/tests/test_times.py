"""Banks on measurements at uneven times."""

from __future__ import annotations

import copy
import json
import subprocess

import numpy as np
import pymmae
import pytest
from conftest import EXAMPLES, SMALL

#: x' = -a x + u + w: a walk that is drawn back, at one of two rates.
WALK = {
    "plant": {
        "time": "continuous",
        "states": ["x"],
        "inputs": ["u"],
        "disturbances": ["w"],
        "outputs": ["y"],
        "A": "-a",
        "B": 1,
        "G": 1,
        "C": 1,
        "Q": 2,
        "R": 0.05,
        "parameters": {"a": 0.1},
    },
    "bank": {"observer": "kalman", "dt": 0.5, "P0": 1, "models": {"a": [0.1, 0.7]}},
}
# s; a step of dt, two of them, and others
T = np.array([0.5, 1.0, 2.0, 2.3, 3.7, 3.8, 4.1])
Y = np.array([0.3, 0.9, np.nan, 1.1, -0.2, 0.1, 0.4])[:, None]
U = np.array([0.0, 1.0, 0.5, -1.0, 0.2, 0.0, 0.0])[:, None]


def test_times_mean_what_they_mean_to_the_command(command, tmp_path):
    scenario = pymmae.Scenario(WALK)
    (tmp_path / "walk.toml").write_text(scenario.text)
    rows = [f"{t},{'' if np.isnan(y) else y},{u}" for t, y, u in zip(T, Y[:, 0], U[:, 0])]
    (tmp_path / "walk.csv").write_text("\n".join(["t,y,u", *rows]))
    arguments = [command, "estimate", tmp_path / "walk.toml", "--data", tmp_path / "walk.csv"]
    arguments += ["--every", "1", "--json"]
    told = json.loads(subprocess.run(arguments, check=True, capture_output=True).stdout)
    got = pymmae.estimate(scenario, Y, U, t=T)
    assert got.time.values.tolist() == T.tolist() == [row["t"] for row in told["record"]]
    for name in ("p", "x_hat", "theta_hat"):
        want = np.array([row[name] for row in told["record"]])
        np.testing.assert_allclose(got[name], want, rtol=1e-15)
    assert got.log_lik_models.values.tolist() == told["loglik"]


def test_a_filter_moves_over_the_time_that_has_passed():
    """The textbook's scalar filter, sampled by hand."""
    got = pymmae.estimate(WALK, Y, U, t=T)
    for i, a in enumerate([0.1, 0.7]):
        x, p, log_lik, last, before = 0.0, 1.0, 0.0, 0.0, 0.0
        for t, y, u in zip(T, Y[:, 0], U[:, 0]):
            f = np.exp(-a * (t - last))
            x = f * x + (1 - f) / a * before
            p = f * f * p + 2 * (1 - f * f) / (2 * a)
            if not np.isnan(y):
                s = p + 0.05 / 0.5
                log_lik -= 0.5 * ((y - x) ** 2 / s + np.log(2 * np.pi * s))
                x, p = x + p / s * (y - x), p - p * p / s
            last, before = t, u
        np.testing.assert_allclose(got.log_lik_models[i], log_lik, rtol=1e-11)


def test_many_records_share_their_times():
    y = np.stack([Y, -Y, 2 * Y])
    for every in (0, 3):
        many = pymmae.estimate(WALK, y, U, t=T, every=every, threads=2)
        assert many.identical(pymmae.estimate(WALK, y, U, t=T, every=every, threads=1))
        assert many.time.values.tolist() == ([4.1] if every == 0 else [2.0, 3.8, 4.1])
        for k in range(3):
            one = pymmae.estimate(WALK, y[k], U, t=T).sel(time=many.time.values)
            for name in ("log_p", "x_hat"):
                assert (one[name].values == many[name][k].values).all()
            assert (one.log_lik_models == many.log_lik_models[k]).all()
    own = pymmae.estimate(WALK, y, np.stack([U, 0 * U, U]), t=T)
    assert (own.log_p[1] == pymmae.estimate(WALK, y[1], 0 * U, t=T).log_p[-1]).all()


def test_even_times_change_no_bit():
    t = 0.5 * np.arange(1, 8)
    plain, timed = pymmae.estimate(WALK, Y, U), pymmae.estimate(WALK, Y, U, t=t)
    assert plain.identical(timed)
    both = np.stack([Y, Y])
    assert pymmae.estimate(WALK, both, U).identical(pymmae.estimate(WALK, both, U, t=t))


def test_a_gap_is_measurements_that_are_missing():
    flow = np.loadtxt(EXAMPLES / "nile.csv", delimiter=",", skiprows=1)[:20, 1:]
    kept, hole = np.r_[0:5, 9:20], flow.copy()
    hole[5:9] = np.nan
    gap = pymmae.estimate(EXAMPLES / "nile.toml", flow[kept], t=1871.0 + kept)
    whole = pymmae.estimate(EXAMPLES / "nile.toml", hole)
    assert (gap.p.values == whole.p.values[kept]).all()
    assert gap.time.values[-1] == 1890


def bank(**changes: object) -> dict[str, object]:
    tables = copy.deepcopy(WALK)
    tables["bank"] |= changes
    tables["bank"] = {k: v for k, v in tables["bank"].items() if v is not None}
    return tables


@pytest.mark.parametrize(
    ("scenario", "t", "word"),
    [
        (bank(P0=None), T, r"t\[3\]: .*gains = \"recursive\""),
        (bank(P0=None, observer=None), T, r"t\[3\]: .*observer = \"kalman\""),
        (SMALL, T, r"t\[3\]: .*not a multiple of dt = 0.5 s"),
        (SMALL, np.r_[0.5 * np.arange(6), 1e9], r"t\[6\]: a gap"),
        (WALK, T[::-1], r"t\[1\]: times must increase"),
        (WALK, T[:3], "t has shape"),
        (WALK, np.r_[T[:-1], np.nan], r"t\[6\] is not"),
        (WALK, T * 1j, "^t "),
        (WALK, [str(t) for t in T], "^t "),
    ],
)
@pytest.mark.parametrize("records", [None, 2])
def test_times_that_are_refused(scenario, t, word, records):
    y = np.nan_to_num(Y) if records is None else np.zeros((records, 7, 1))
    with pytest.raises((ValueError, TypeError), match=word) as caught:
        pymmae.estimate(scenario, y, t=t)
    assert isinstance(caught.value, pymmae.Error)
