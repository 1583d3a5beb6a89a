"""Who takes part in each case; what SciPy and SLICOT do with equations."""

import bank
import eip
import least_squares
import numpy as np
import scipy.linalg as sl
import slicot
from problems import problems

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


def contenders(case):
    """Name and function of everyone who takes part in `case`."""
    if case.startswith("eip_"):
        return eip.contenders(case.removeprefix("eip_"))
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
