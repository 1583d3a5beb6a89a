"""Equations on stacked arrays, against SciPy and against themselves."""

from __future__ import annotations

import pickle

import numpy as np
import pymmae
import pytest
import scipy.linalg as sl
from conftest import spd, stable
from hypothesis import example, given, settings
from hypothesis import strategies as st

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=25, deadline=None)


def care_problem(seed: int, len_: int, n: int, m: int):
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((len_, n, n)), rng.standard_normal((len_, n, m))
    return a, b, spd(rng, len_, n, n), spd(rng, len_, m, m)


@FEW
@given(SEEDS, st.integers(1, 9), st.integers(1, 5), st.integers(1, 3))
@example(2278, 4, 5, 1)
def test_care_agrees_with_scipy(seed, len_, n, m):
    a, b, q, r = care_problem(seed, len_, n, m)
    got = pymmae.care(a, b, q, r)
    assert got.X.shape == (len_, n, n) and not got.failed.any()
    # X rounded to the last bit has a residual that grows with the condition: in the example
    # 1.9e-11 where X is right to 1e-16
    assert (got.error_bound < 1e-8).all()
    assert (got.residual < 1e-12 * (1 + got.condition)).all()
    for k in range(len_):
        want = sl.solve_continuous_are(a[k], b[k], q[k], r[k])
        assert np.linalg.norm(got.X[k] - want) <= 1e-6 * np.linalg.norm(want)


@FEW
@given(SEEDS, st.integers(1, 9), st.integers(1, 5), st.integers(1, 3))
def test_dare_agrees_with_scipy(seed, len_, n, m):
    a, b, q, r = care_problem(seed, len_, n, m)
    got = pymmae.dare(a, b, q, r)
    for k in range(len_):
        want = sl.solve_discrete_are(a[k], b[k], q[k], r[k])
        assert np.linalg.norm(got.X[k] - want) <= 1e-6 * np.linalg.norm(want)


@FEW
@given(SEEDS, st.integers(1, 9), st.integers(1, 5), st.integers(1, 4))
def test_linear_equations_have_small_residuals(seed, len_, n, m):
    rng = np.random.default_rng(seed)
    a, b = stable(rng, len_, n, n), stable(rng, len_, m, m)
    c, q = rng.standard_normal((len_, n, m)), spd(rng, len_, n, n)
    x = pymmae.sylvester(a, b, c).X
    assert np.abs(a @ x + x @ b + c).max() <= 1e-10 * (1 + np.abs(x).max())
    x = pymmae.lyap(a, q).X
    assert np.abs(a @ x + x @ a.transpose(0, 2, 1) + q).max() <= 1e-10 * (1 + np.abs(x).max())
    half = 0.5 * a / np.abs(np.linalg.eigvals(a)).max()
    x = pymmae.lyap(half, q, discrete=True).X
    assert np.abs(half @ x @ half.transpose(0, 2, 1) - x + q).max() <= 1e-10 * np.abs(x).max()
    both = 0.5 * b / np.abs(np.linalg.eigvals(b)).max()
    x = pymmae.sylvester(half, both, c, discrete=True).X
    assert np.abs(half @ x @ both - x + c).max() <= 1e-10 * (1 + np.abs(x).max())


@FEW
@given(SEEDS, st.integers(1, 4))
def test_steps_of_the_differential_equation_compose(seed, n):
    rng = np.random.default_rng(seed)
    f, h = rng.standard_normal((n, n)), rng.standard_normal((1, n))
    q, p, r = spd(rng, n, n), spd(rng, n, n), np.eye(1)
    half = pymmae.riccati_ode(f, h, q, r, p, 0.2).X
    two = pymmae.riccati_ode(f, h, q, r, half, 0.2).X
    one = pymmae.riccati_ode(f, h, q, r, p, 0.4).X
    assert np.abs(one - two).max() <= 1e-9 * np.abs(one).max()


@FEW
@given(SEEDS, st.integers(2, 20), st.integers(1, 4))
def test_a_batch_is_its_items_by_bits(seed, len_, n):
    a, b, q, r = care_problem(seed, len_, n, 1)
    whole = pymmae.care(a, b, q, r, threads=2)
    for k in range(len_):
        alone = pymmae.care(a[k], b[k], q[k], r[k], threads=1)
        assert (alone.X == whole.X[k]).all()
        assert alone.residual == whole.residual[k] and alone.margin == whole.margin[k]


def views(a: np.ndarray):
    """The same numbers in other clothes."""
    yield "F order", np.asfortranarray(a)
    wide = np.zeros((*a.shape[:-1], 2 * a.shape[-1]))
    wide[..., ::2] = a
    yield "every second", wide[..., ::2]
    yield "reversed", a[::-1, ::-1, ::-1].copy()[::-1, ::-1, ::-1]
    odd = np.frombuffer(b"x" + a.tobytes(), dtype=np.float64, offset=1)
    yield "unaligned", odd.reshape(a.shape)
    frozen = a.copy()
    frozen.flags.writeable = False
    yield "read-only", frozen
    yield "list", a.tolist()


def test_strides_and_order_do_not_matter_and_inputs_stay():
    a, b, q, r = care_problem(7, 6, 3, 2)
    want = pymmae.care(a, b, q, r).X
    for name, other in views(a):
        before = np.array(other)
        assert (pymmae.care(other, b, q, r).X == want).all(), name
        assert (np.array(other) == before).all(), name
    # broadcast with stride 0 is one matrix each
    one = np.broadcast_to(a[0], a.shape)
    assert (pymmae.care(one, b, q, r).X == pymmae.care(a[0], b, q, r).X).all()


def test_promotion_of_float32_and_integers():
    a, b, q, r = care_problem(3, 4, 2, 1)
    single = a.astype(np.float32)
    assert (pymmae.care(single, b, q, r).X == pymmae.care(single.astype(float), b, q, r).X).all()
    for dtype in ("i1", "u2", "i4", "i8", "f2"):
        eye = np.eye(2, dtype=dtype)
        assert pymmae.lyap(-np.eye(2), eye).X[0, 0] == 0.5


def test_leading_dimensions_broadcast():
    a, b, q, r = care_problem(5, 6, 2, 1)
    got = pymmae.care(a.reshape(2, 3, 2, 2), b[:3], q[0], r[0])
    assert got.X.shape == (2, 3, 2, 2) and got.residual.shape == (2, 3)
    for i in range(2):
        for j in range(3):
            assert (got.X[i, j] == pymmae.care(a[3 * i + j], b[j], q[0], r[0]).X).all()


def test_a_bad_item_is_flagged_and_the_others_are_not_affected():
    a, b, q, r = care_problem(11, 5, 2, 1)
    want = pymmae.care(a, b, q, r).X
    a[1, 0, 1] = np.nan
    b[3], a[3] = 0, np.eye(2)
    got = pymmae.care(a, b, q, r)
    assert got.failed.tolist() == [False, True, False, True, False]
    assert got.status.tolist() == ["ok", "not_finite", "ok", "not_stabilizable", "ok"]
    assert np.isnan(got.X[got.failed]).all()
    assert (got.X[~got.failed] == want[~got.failed]).all()
    assert isinstance(got.errors[(1,)], pymmae.InputError)
    assert "not stabilizable" in str(got.errors[(3,)])
    with pytest.raises(pymmae.InputError):
        got.raise_for_status()
    with pytest.raises(pymmae.NumericalError, match="stabilizable"):
        pymmae.care(a[3], b[3], q[3], r[3])


def test_results_pickle_with_their_errors():
    a, b, q, r = care_problem(11, 5, 2, 1)
    a[1, 0, 1] = np.inf
    got = pymmae.care(a, b, q, r)
    again = pickle.loads(pickle.dumps(got))
    assert again.X.tobytes() == got.X.tobytes()
    assert again.errors[(1,)].code == "not_finite"
    assert str(again.errors[(1,)]) == str(got.errors[(1,)])


def test_frozen_arrays_are_used_in_place_and_results_are_not_copied():
    from pymmae import _core

    a = np.random.default_rng(1).standard_normal((1000, 4, 4))
    address = a.__array_interface__["data"][0]
    assert _core._where(a) != (address, True)
    a.flags.writeable = False
    assert _core._where(a) == (address, True)
    assert _core._where(a[3]) == (a[3].__array_interface__["data"][0], True)
    writable = np.zeros((4, 4))
    view = writable[:]
    view.flags.writeable = False  # its base can still be written to
    assert _core._where(view)[1] is False
    x = pymmae.lyap(np.broadcast_to(-np.eye(4), (1000, 4, 4)), np.eye(4)).X
    assert x.base is not None and x.flags.c_contiguous  # memory of the engine's
