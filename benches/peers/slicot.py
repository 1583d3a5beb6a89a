"""SLICOT with its own verification: SB02RD (job A) and SB03MD (job B) return X with a
separation and a forward error bound, Riccati equations with a reciprocal condition too.
slycot has no Python face for these jobs; its shared library exports the routines, which are
called here in arrays made once: no time of a wrapper counts against them."""

import ctypes
import glob
import os

import numpy as np


def library(slycot):
    """The shared library of an installed slycot, if it exports both routines."""
    found = glob.glob(os.path.join(os.path.dirname(slycot.__file__), "_wrapper*"))
    try:
        lib = ctypes.CDLL(found[0])
        return lib if lib.sb02rd_ and lib.sb03md_ else None
    except (IndexError, OSError, AttributeError):
        return None


def array(*shape):
    return np.zeros(shape, order="F")


def pointer(x):
    return x.ctypes.data_as(ctypes.c_void_p)


def fortran(routine, letters, rest):
    """A call of `routine`: its letters, then `rest` (arrays, integers, numbers to write to,
    and INFO at the end); the length of every letter goes behind all else."""

    def passed(x):
        if isinstance(x, np.ndarray):
            return pointer(x)
        return ctypes.byref(ctypes.c_int(x) if isinstance(x, int) else x)

    routine.restype = None
    arguments = [ctypes.c_char_p(k.encode()) for k in letters] + [passed(x) for x in rest]
    arguments += [ctypes.c_size_t(1)] * len(letters)

    def call():
        routine(*arguments)
        if rest[-1].value != 0:
            raise ArithmeticError(f"SLICOT: INFO = {rest[-1].value}")

    return call


def bounded_solver(lib, kind, n):
    """One equation of order n: X; the bound of its error is then in `one.bound`."""
    a, x, t, v, g, q = (array(n, n) for _ in range(6))
    s, work = array(2 * n, 2 * n), array(60 * n * n + 400)
    real, imaginary = array(2 * n), array(2 * n)
    whole, logical = (np.zeros(k, dtype=np.int32) for k in (max(2 * n, n * n), 2 * n))
    sep, rcond, bound, scale, info = (*(ctypes.c_double() for _ in range(4)), ctypes.c_int())
    work = [whole, work, work.size]
    if kind in ("care", "dare"):
        # All of it ("A"), scaled ("G"); the closed loop is factored here ("N") and the Lyapunov
        # equations of the bound are those of the original matrices ("O").
        letters = "ACDNUGSNO" if kind == "care" else "ADDNUGUNO"
        rest = [n, a, n, t, n, v, n, g, n, q, n, x, n, sep, rcond, bound, real, imaginary, s, 2 * n]
        call = fortran(lib.sb02rd_, letters, [*rest, *work, logical, info])
    else:
        # op(A) = A': A X + X A' = C or A X A' - X = C, solved in the place of C.
        letters = "CBNT" if kind == "clyap" else "DBNT"
        rest = [n, a, n, v, n, x, n, scale, sep, bound, real, imaginary]
        call = fortran(lib.sb03md_, letters, [*rest, *work, info])

    def one(a_k, b_k, q_k):
        a[:] = a_k
        if b_k is None:
            np.negative(q_k, out=x)
        else:
            np.matmul(b_k, b_k.T, out=g)
            q[:] = q_k
        call()
        one.bound = bound.value
        return x

    return one
