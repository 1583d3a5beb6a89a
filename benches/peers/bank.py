"""The bank given its measurements: steady Kalman filters of N models on T records."""

import os
import subprocess

import numpy as np
import scipy.linalg as sl
from problems import CHECKED_RECORDS, bank_problem

try:
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
except ImportError:
    jax = None
try:
    import simdkalman
except ImportError:
    simdkalman = None
try:
    from filterpy.kalman import KalmanFilter
except ImportError:
    KalmanFilter = None
try:
    import torch
    import torch_kf

    torch.set_num_threads(1)
except ImportError:
    torch = None
# Built by run.sh where a compiler and Eigen are there.
EIGEN = os.environ.get("PEERS_EIGEN")


def design(a, c):
    """Steady P(k|k-1), S and K of every model."""
    n, q = a.shape[-1], c.shape[-2]
    p = np.array([sl.solve_discrete_are(x.T, y.T, np.eye(n), np.eye(q)) for x, y in zip(a, c)])
    s = c @ p @ c.transpose(0, 2, 1) + np.eye(q)
    k = p @ c.transpose(0, 2, 1) @ np.linalg.inv(s)
    return p, s, k


def whitened(s):
    """W with W' W = S^-1, and the constant of the log-likelihood."""
    w = np.linalg.inv(np.linalg.cholesky(s))
    return w, -0.5 * (np.linalg.slogdet(s)[1] + s.shape[-1] * np.log(2 * np.pi))


def summary(log_lik, steps):
    """Mean log-likelihood a step of the first records, shape (model, record)."""
    return float(np.mean(log_lik[:, :CHECKED_RECORDS]) / steps)


def posterior(log_lik):
    p = np.exp(log_lik - log_lik.max(axis=0))
    return p / p.sum(axis=0)


def numpy_panel(name):
    """All models and records at once, a step at a time."""
    a, c, y = bank_problem(name)
    _, s, k = design(a, c)
    w, norm = whitened(s)
    models, n = a.shape[:2]
    records, steps, q = y.shape
    seen = np.ascontiguousarray(y.transpose(1, 2, 0))

    def run():
        x = np.zeros((models, n, records))
        log_lik = np.zeros((models, records))
        for t in range(steps):
            r = seen[t] - c @ x
            log_lik -= 0.5 * np.square(w @ r).sum(axis=1)
            x = a @ (x + k @ r)
        log_lik += steps * norm[:, None]
        posterior(log_lik)
        return models * records * steps, summary(log_lik, steps)

    return run


def jax_scan(name):
    """The same under jit: scan over time, one contraction a step."""
    a, c, y = bank_problem(name)
    _, s, k = design(a, c)
    w, norm = whitened(s)
    models, n = a.shape[:2]
    records, steps, q = y.shape
    # x <- A x + A K r, whitened residual: three small products a step
    ak = a @ k

    def step(carry, seen):
        x, log_lik = carry
        r = seen[None] - jnp.einsum("mqn,mnt->mqt", c, x)
        e = jnp.einsum("mpq,mqt->mpt", w, r)
        x = jnp.einsum("mij,mjt->mit", a, x) + jnp.einsum("miq,mqt->mit", ak, r)
        return (x, log_lik - 0.5 * jnp.square(e).sum(axis=1)), None

    @jax.jit
    def whole(seen):
        start = (jnp.zeros((models, n, records)), jnp.zeros((models, records)))
        (_, log_lik), _ = jax.lax.scan(step, start, seen)
        log_lik = log_lik + steps * norm[:, None]
        return log_lik, jax.nn.softmax(log_lik, axis=0)

    seen = jnp.asarray(np.ascontiguousarray(y.transpose(1, 2, 0)))

    def run():
        log_lik, p = whole(seen)
        p.block_until_ready()
        return models * records * steps, summary(np.asarray(log_lik), steps)

    return run


def with_simdkalman(name):
    """A filter a model on all records; it recomputes the covariances."""
    a, c, y = bank_problem(name)
    p, _, _ = design(a, c)
    models, n = a.shape[:2]
    records, steps, q = y.shape
    data = y if q > 1 else y[:, :, 0]
    filters = [
        simdkalman.KalmanFilter(a[i], np.eye(n), c[i], np.eye(q)) for i in range(models)
    ]

    def run():
        log_lik = np.empty((models, records))
        for i, one in enumerate(filters):
            done = one.compute(
                data, 0, initial_value=np.zeros(n), initial_covariance=p[i],
                smoothed=False, filtered=True, states=False, observations=False, log_likelihood=True,
            )
            # it leaves the constant out
            log_lik[i] = done.log_likelihood - 0.5 * steps * q * np.log(2 * np.pi)
        return models * records * steps, summary(log_lik, steps)

    return run


def with_filterpy(name):
    """A filter object a model and record, the first records only."""
    a, c, y = bank_problem(name)
    p, _, _ = design(a, c)
    models, n = a.shape[:2]
    steps, q = y.shape[1:]

    def run():
        log_lik = np.zeros((models, CHECKED_RECORDS))
        for i in range(models):
            for t in range(CHECKED_RECORDS):
                one = KalmanFilter(dim_x=n, dim_z=q)
                one.F, one.H, one.Q, one.R, one.P = a[i], c[i], np.eye(n), np.eye(q), p[i].copy()
                for z in y[t]:
                    one.update(z)
                    log_lik[i, t] += one.log_likelihood
                    one.predict()
        return models * CHECKED_RECORDS * steps, summary(log_lik, steps)

    return run


def with_torch_kf(name):
    """All models and records as one batch; it recomputes the covariance of every record."""
    a, c, y = bank_problem(name)
    p, _, _ = design(a, c)
    models, n = a.shape[:2]
    records, steps, q = y.shape

    def tensor(x):
        return torch.tensor(x, dtype=torch.float64)

    one = torch_kf.KalmanFilter(
        tensor(a[:, None]), tensor(c[:, None]), torch.eye(n, dtype=torch.float64), torch.eye(q, dtype=torch.float64)
    )
    seen = tensor(y).permute(1, 0, 2)[:, None, :, :, None]

    def run():
        with torch.no_grad():
            mean = torch.zeros((models, records, n, 1), dtype=torch.float64)
            state = torch_kf.GaussianState(mean, tensor(p[:, None]).expand(-1, records, -1, -1).clone())
            log_lik = torch.zeros((models, records), dtype=torch.float64)
            for t in range(steps):
                projection = one.project(state)
                log_lik += projection.log_likelihood(seen[t]).reshape(models, records)
                state = one.predict(one.update(state, seen[t], projection=projection))
            return models * records * steps, summary(log_lik.numpy(), steps)

    return run


def with_eigen(kind, name):
    """A pass of the C++ program, which waits for a line each time."""
    program = subprocess.Popen(
        [EIGEN, f"{kind}_{name}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )

    def run():
        program.stdin.write("\n")
        program.stdin.flush()
        items, checksum = program.stdout.readline().split()
        return float(items), float(checksum)

    return run


def contenders(name):
    out = {"NumPy, panel": numpy_panel(name)}
    if EIGEN:
        out["Eigen, a filter a record"] = with_eigen("record", name)
        out["Eigen, records in lanes"] = with_eigen("lanes", name)
    if torch is not None:
        out["torch-kf"] = with_torch_kf(name)
    if jax is not None:
        out["JAX, jit and scan"] = jax_scan(name)
    if simdkalman is not None:
        out["simdkalman"] = with_simdkalman(name)
    if KalmanFilter is not None:
        out["FilterPy"] = with_filterpy(name)
    return out


def simulate_numpy(name):
    """Noise, truth, bank, weights and squared error: everything drawn anew."""
    a, c, y = bank_problem(name)
    _, s, k = design(a, c)
    w, norm = whitened(s)
    models, n = a.shape[:2]
    records, steps, q = y.shape
    rng = np.random.Generator(np.random.SFC64(1))

    def run():
        x = np.zeros((n, records))
        xhat = np.zeros((models, n, records))
        log_lik = np.zeros((models, records))
        for _ in range(steps):
            x = a[0] @ x + rng.standard_normal((n, records))
            xhat = a @ xhat
            r = (c[0] @ x + rng.standard_normal((q, records))) - c @ xhat
            nis = np.square(w @ r).sum(axis=1)
            log_lik -= 0.5 * nis
            xhat = xhat + k @ r
        p = posterior(log_lik + steps * norm[:, None])
        np.square(x - np.einsum("mt,mnt->nt", p, xhat)).sum(axis=0)
        return models * records * steps, float(nis[0].mean() / q)

    return run


def simulate_jax(name):
    """The same under jit."""
    a, c, y = bank_problem(name)
    _, s, k = design(a, c)
    w, norm = whitened(s)
    models, n = a.shape[:2]
    records, steps, q = y.shape

    def step(carry, key):
        x, xhat, log_lik, _ = carry
        noise = jax.random.normal(key, (n + q, records), dtype=jnp.float64)
        x = a[0] @ x + noise[:n]
        xhat = jnp.einsum("mij,mjt->mit", a, xhat)
        r = (c[0] @ x + noise[n:])[None] - jnp.einsum("mqn,mnt->mqt", c, xhat)
        nis = jnp.square(jnp.einsum("mpq,mqt->mpt", w, r)).sum(axis=1)
        xhat = xhat + jnp.einsum("miq,mqt->mit", k, r)
        return (x, xhat, log_lik - 0.5 * nis, nis), None

    @jax.jit
    def whole(key):
        zero = jnp.zeros((models, records))
        start = (jnp.zeros((n, records)), jnp.zeros((models, n, records)), zero, zero)
        (x, xhat, log_lik, nis), _ = jax.lax.scan(step, start, jax.random.split(key, steps))
        p = jax.nn.softmax(log_lik + steps * norm[:, None], axis=0)
        return nis[0].mean() / q, jnp.square(x - jnp.einsum("mt,mnt->nt", p, xhat)).sum(axis=0)

    def run():
        nis, error = whole(jax.random.key(1))
        error.block_until_ready()
        return models * records * steps, float(nis)

    return run


def simulators(name):
    out = {"NumPy, panel": simulate_numpy(name)}
    if EIGEN:
        out["Eigen, a trial at a time"] = with_eigen("simulate", name)
    if jax is not None:
        out["JAX, jit and scan"] = simulate_jax(name)
    return out
