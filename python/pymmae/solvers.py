"""Riccati, Lyapunov and Sylvester equations on stacked arrays.

Every function takes arrays of shape ``(..., rows, columns)`` and solves one equation for
each index of the leading dimensions, which broadcast as in NumPy: an argument may be one
matrix for all. It returns :class:`Solutions`, which hold ``X`` together with what is known
about each.

An equation without a solution is data in a batch: it is flagged, its ``X`` is NaN, the
others are not affected. A single equation (no leading dimensions) raises its error.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from .errors import Error

Checks = Literal["all", "stability"]


@dataclass(frozen=True, eq=False)
class Solutions:
    """Solutions of a batch of equations and what is known about each.

    All arrays but ``X`` have the leading dimensions of the arguments.
    """

    #: The solutions, ``(..., n, n)`` (Sylvester: ``(..., n, m)``); NaN where ``failed``.
    X: NDArray[np.float64]
    #: Frobenius norm of the residual over the norms of its terms, balanced coordinates.
    residual: NDArray[np.float64]
    #: Bound on ``|X - X_exact| / |X|``; NaN where none was computed.
    error_bound: NDArray[np.float64]
    #: A relative change d of the data moves ``X`` by up to ``condition * d``.
    condition: NDArray[np.float64]
    #: Verified margin of stability of the closed loop; 1/s in continuous time.
    margin: NDArray[np.float64]
    #: Doubling steps spent, corrections included.
    iterations: NDArray[np.uint32]
    #: False where ``X`` should not be used without thought.
    reliable: NDArray[np.bool_]
    #: True where there is no solution.
    failed: NDArray[np.bool_]
    #: Why, by index: typed exceptions that were not raised.
    errors: dict[tuple[int, ...], Error] = field(default_factory=dict)

    @property
    def status(self) -> NDArray[np.str_]:
        """``"ok"``, or the code of the error, for every item."""
        status = np.full(self.failed.shape, "ok", dtype="U32")
        for index, error in self.errors.items():
            status[index] = error.code
        return status

    def raise_for_status(self) -> Solutions:
        """Raises the first error, if there is one; returns the solutions."""
        for error in self.errors.values():
            raise error
        return self

    def __len__(self) -> int:
        return self.failed.size


def _solutions(raw: dict[str, Any]) -> Solutions:
    failed = raw["failed"]
    errors = {tuple(map(int, np.unravel_index(k, failed.shape))): e for k, e in raw["errors"]}
    raw["errors"] = errors
    del raw["alone"]
    solutions = Solutions(**raw)
    return solutions.raise_for_status() if failed.ndim == 0 else solutions


def care(
    A: ArrayLike,
    B: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    S: ArrayLike | None = None,
    *,
    checks: Checks = "all",
    threads: int | None = None,
) -> Solutions:
    """Stabilizing solutions of continuous-time algebraic Riccati equations.

    .. code-block:: text

        A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0

    Shapes: ``A`` ``(..., n, n)``, ``B`` ``(..., n, m)``, ``Q`` ``(..., n, n)`` and ``R``
    ``(..., m, m)`` symmetric, ``S`` ``(..., n, m)``. Units: with ``x`` in units of the
    state, ``Q`` and ``R`` weigh squares of state and input. For a filter pass ``A'`` for
    ``A`` and ``C'`` for ``B``: ``X`` is then the error covariance.

    ``checks="stability"`` leaves out the bound on the error and the condition. ``threads``
    are as many as there are CPUs unless stated; the bits are the same for any number.

    Source: structure-preserving doubling, Chu, Fan, Lin (2005), J. Comput. Appl. Math. 195.

    Raises ``InputError`` and ``DTypeError`` for arguments that are no such matrices,
    ``NumericalError`` for a single equation without a solution; in a batch such an item
    is flagged.

    >>> import numpy as np, pymmae
    >>> A, B = np.array([[0.0, 1.0], [-1.0, -0.2]]), np.array([[0.0], [1.0]])
    >>> X = pymmae.care(A, B, np.eye(2), np.eye(1)).X
    >>> residual = A.T @ X + X @ A - X @ B @ B.T @ X + np.eye(2)
    >>> bool(abs(residual).max() < 1e-14)
    True
    """
    return _solutions(_core.care(A, B, Q, R, S, False, checks, threads))


def dare(
    A: ArrayLike,
    B: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    S: ArrayLike | None = None,
    *,
    checks: Checks = "all",
    threads: int | None = None,
) -> Solutions:
    """Stabilizing solutions of discrete-time algebraic Riccati equations.

    .. code-block:: text

        A'XA - X - (A'XB + S)(R + B'XB)^-1 (B'XA + S') + Q = 0

    Shapes, units, settings and errors as in :func:`care`. For a filter pass ``A'`` for
    ``A`` and ``C'`` for ``B``: ``X`` is then the covariance of the prediction.

    Source: structure-preserving doubling, Chu, Fan, Lin, Wang (2004), Int. J. Control 77.

    >>> import numpy as np, pymmae
    >>> rho = np.linspace(0.5, 0.99, 1000)[:, None, None]   # a thousand scalar filters
    >>> p = pymmae.dare(rho, np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1))).X
    >>> bool(np.allclose(rho**2 * p / (p + 1) + 1, p, rtol=1e-13))
    True
    """
    return _solutions(_core.care(A, B, Q, R, S, True, checks, threads))


def lyap(
    A: ArrayLike,
    Q: ArrayLike,
    *,
    discrete: bool = False,
    checks: Checks = "all",
    threads: int | None = None,
) -> Solutions:
    """Solutions of Lyapunov equations.

    .. code-block:: text

        continuous   A X + X A' + Q = 0
        discrete     A X A' - X + Q = 0

    Shapes: ``A`` and ``Q`` ``(..., n, n)``, ``Q`` symmetric. With stable ``A`` and ``Q`` the
    intensity (covariance) of the noise ``X`` is the stationary covariance of the state, in
    squares of its units.

    Source: doubling (Smith 1968, SIAM J. Appl. Math. 16), Kronecker's form where ``A`` is
    not stable. Errors as in :func:`care`.

    >>> import numpy as np, pymmae
    >>> X = pymmae.lyap([[-1.0, 1.0], [0.0, -2.0]], np.eye(2)).X
    >>> bool(abs(X[1, 1] - 0.25) < 1e-15)
    True
    """
    return _solutions(_core.lyapunov(A, Q, discrete, checks, threads))


def sylvester(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    *,
    discrete: bool = False,
    checks: Checks = "all",
    threads: int | None = None,
) -> Solutions:
    """Solutions of Sylvester equations.

    .. code-block:: text

        continuous   A X + X B + C = 0
        discrete     A X B - X + C = 0

    Shapes: ``A`` ``(..., n, n)``, ``B`` ``(..., m, m)``, ``C`` and ``X`` ``(..., n, m)``.
    SciPy's ``solve_sylvester(a, b, q)`` solves ``a x + x b = q``: pass ``C = -q``.

    Source: doubling where the coefficients are stable, Kronecker's form elsewhere. Errors
    as in :func:`care`.

    >>> import numpy as np, pymmae
    >>> A, B, C = -2.0 * np.eye(2), -np.eye(3), np.ones((2, 3))
    >>> bool(np.allclose(pymmae.sylvester(A, B, C).X, C / 3, rtol=1e-15))
    True
    """
    return _solutions(_core.sylvester(A, B, C, discrete, checks, threads))


def riccati_ode(
    F: ArrayLike,
    H: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    P: ArrayLike,
    h: ArrayLike,
    *,
    threads: int | None = None,
) -> Solutions:
    """Exact steps of the Riccati differential equation of a Kalman-Bucy filter.

    .. code-block:: text

        dP/dt = F P + P F' - P H' R^-1 H P + Q,    P(0) = P,  wanted X = P(h)

    Shapes: ``F``, ``Q``, ``P`` ``(..., n, n)``, ``H`` ``(..., m, n)``, ``R`` ``(..., m, m)``
    positive definite, ``h`` ``(...)`` in seconds, positive. ``Q`` and ``R`` are intensities.

    Source: Kalman and Bucy (1961), eq. 15; doubling of the step. ``NumericalError`` if the
    solution leaves the finite within the step.

    >>> import numpy as np, pymmae
    >>> one = np.ones((1, 1))
    >>> P = pymmae.riccati_ode(0 * one, one, one, one, 0 * one, 0.3).X
    >>> bool(abs(P[0, 0] - np.tanh(0.3)) < 1e-15)
    True
    """
    return _solutions(_core.riccati_ode(F, H, Q, R, P, h, threads))
