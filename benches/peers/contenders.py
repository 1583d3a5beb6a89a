"""What SciPy, SLICOT and NumPy do with the problems: each returns X, or Upsilon."""

import bank
import least_squares
import numpy as np
import scipy.linalg as sl
import slicot
from problems import C_K, LENGTHS, NOMINALS, THETA, closed_loop, pendulum, problems

try:
    import slycot
except ImportError:
    slycot = None


def scipy_solver(kind):
    def one(a, b, q):
        if kind == "care":
            return sl.solve_continuous_are(a, b, q, np.eye(b.shape[1]))
        if kind == "dare":
            return sl.solve_discrete_are(a, b, q, np.eye(b.shape[1]))
        if kind == "clyap":
            return sl.solve_continuous_lyapunov(a, -q)
        return sl.solve_discrete_lyapunov(a, q)

    return one


def slicot_solver(kind):
    def one(a, b, q):
        n = a.shape[0]
        if kind in ("care", "dare"):
            # The stabilizing solution belongs to the unstable part of its symplectic matrix.
            dico, sort = ("C", "S") if kind == "care" else ("D", "U")
            return slycot.sb02md(n, a, b @ b.T, q, dico, sort=sort)[0]
        dico = "C" if kind == "clyap" else "D"
        # SLICOT solves op(A)' X op(A) - X = C or op(A)' X + X op(A) = C.
        return slycot.sb03md57(a.copy(), None, -q, dico, trana="T")[2]

    return one


def in_a_loop(one, kind, n):
    """One pass over the items: their number, and the mean trace of X."""
    a, b, q = problems(kind, n)
    b = [None] * len(a) if b is None else b

    def run():
        traces = [np.trace(one(a[k], b[k], q[k])) for k in range(len(a))]
        return len(a), float(np.mean(traces))

    return run


def observer(length):
    a, bu, g5, c = pendulum(length)
    p = sl.solve_continuous_are(a.T, c.T, g5 @ g5.T, THETA)
    h = p @ c.T @ np.linalg.inv(THETA)
    return a, bu, h, a - h @ c


E_ROWS = np.eye(5, 9)
C_ROWS = np.eye(2, 5)
C_U = np.hstack([np.zeros((1, 5)), C_K])
WEIGHT = np.linalg.inv(THETA)
D_Y = np.hstack([np.zeros((2, 1)), np.sqrt(THETA)])


def eip_scipy():
    """One Lyapunov equation of order 14 per pair (Bartels and Stewart)."""
    models = [observer(length) for length in NOMINALS]
    upsilon = np.empty((len(LENGTHS), len(models)))
    for k, length in enumerate(LENGTHS):
        loop, noise = closed_loop(length)
        for i, (a, bu, h, f) in enumerate(models):
            drift = E_ROWS @ loop - a @ E_ROWS - bu @ C_U
            low = E_ROWS @ noise - h @ D_Y
            big = np.block([[loop, np.zeros((9, 5))], [drift, f]])
            g = np.vstack([noise, low])
            x = sl.solve_continuous_lyapunov(big, -g @ g.T)
            upsilon[k, i] = 0.5 * np.trace(WEIGHT @ x[9:11, 9:11])
    return summary(upsilon)


def eip_numpy(lengths=LENGTHS, nominals=NOMINALS, spacing=1):
    """The same by eigenvectors, all plants at once: no Lyapunov equation per pair. The
    mean is that of every `spacing`-th plant."""
    models = [observer(length) for length in nominals]
    loops = [closed_loop(length) for length in lengths]
    loop, noise = (np.array([p[j] for p in loops]) for j in (0, 1))
    lam, v = np.linalg.eig(loop)
    vi = np.linalg.inv(v)
    bb = vi @ (noise @ noise.transpose(0, 2, 1)) @ vi.transpose(0, 2, 1)
    x = (v @ (-bb / (lam[:, :, None] + lam[:, None, :])) @ v.transpose(0, 2, 1)).real
    upsilon = np.empty((len(lengths), len(models)))
    for i, (a, bu, h, f) in enumerate(models):
        z = sl.solve_continuous_lyapunov(f.T, -C_ROWS.T @ WEIGHT @ C_ROWS)
        drift = E_ROWS @ loop - a @ E_ROWS - bu @ C_U
        low = E_ROWS @ noise - h @ D_Y
        mu, u = np.linalg.eig(f)
        rhs = x @ drift.transpose(0, 2, 1) + noise @ low.transpose(0, 2, 1)
        modal = vi @ rhs @ np.linalg.inv(u).T
        x12 = -(v @ (modal / (lam[:, :, None] + mu)) @ u.T).real
        own = np.einsum("ij,kil,kjl->k", z, low, low)
        cross = 2.0 * np.einsum("ij,kjl,kli->k", z, drift, x12)
        upsilon[:, i] = 0.5 * (own + cross)
    return upsilon.size, summary(upsilon[::spacing])[1]


def eip_numpy_256():
    return eip_numpy(np.linspace(0.9, 1.9, 4001), np.linspace(0.9, 1.9, 256), 100)


def summary(upsilon):
    return upsilon.size, float(np.mean(np.log(upsilon)))


def contenders(case):
    """Name and function of everyone who takes part in `case`."""
    if case == "eip_pendulum":
        return {"SciPy, Lyapunov per pair": eip_scipy, "NumPy, eigenvectors": eip_numpy}
    if case == "eip_pendulum_N256":
        return {"NumPy, eigenvectors": eip_numpy_256}
    if case.startswith("bank_"):
        return bank.contenders(case.removeprefix("bank_"))
    if case.startswith("simulate_"):
        return bank.simulators(case.removeprefix("simulate_"))
    if case.startswith("rls_"):
        # the loop is ours as well: what the lanes are worth
        p = int(case.removeprefix("rls_p").removesuffix("_loop"))
        return least_squares.contenders(p)
    # ours alone may leave out the error bounds
    kind, n = case.removesuffix("_nobound").rsplit("_n", 1)
    out = {"SciPy": in_a_loop(scipy_solver(kind), kind, int(n))}
    if slycot is not None:
        out["SLICOT"] = in_a_loop(slicot_solver(kind), kind, int(n))
        lib = slicot.library(slycot)
        if lib is not None:
            out["SLICOT with its bound"] = in_a_loop(slicot.bounded_solver(lib, kind, int(n)), kind, int(n))
    return out
