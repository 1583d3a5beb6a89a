"""Plants from matrices: stacked over a grid, or from a function evaluated once over it.

Plants whose entries are expressions of named parameters need none of this: write them
under ``"plant"`` of a :class:`pymmae.Scenario`, in the language of scenario files.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import convert, room
from .errors import DTypeError, InputError

Array = NDArray[np.float64]
_LETTERS = ("A", "B", "G", "C", "Q", "R")


@dataclass(frozen=True, eq=False)
class Family:
    """A family of plants given by matrices at the points of a grid.

    .. code-block:: text

        x' = A x + B u + G w,   y = C x + v,   E[w w'] = Q,  E[v v'] = R

    Matrices have the dimensions of the grid before rows and columns, or none of them if
    they are the same everywhere. Plants between the points (which a search for boundaries
    asks for) are interpolated linearly in each parameter; at the points they are exact.
    So boundaries are those of the interpolated family: off by the square of the spacing.

    Made by :meth:`from_stacked` and :meth:`from_function`; used as ``family=`` of
    :class:`pymmae.Scenario`.
    """

    #: Values of every parameter, rising.
    axes: dict[str, Array]
    #: The value of each where a grid or a model does not say otherwise.
    nominal: dict[str, float]
    #: Names of states, inputs, disturbances, outputs.
    names: tuple[list[str], list[str], list[str], list[str]]
    #: Seconds between samples; ``None`` in continuous time.
    dt: float | None
    #: The matrices by letter.
    matrices: dict[str, Array]

    @classmethod
    def from_stacked(
        cls,
        axes: Mapping[str, ArrayLike],
        *,
        A: ArrayLike,
        C: ArrayLike,
        R: ArrayLike,
        B: ArrayLike | None = None,
        G: ArrayLike | None = None,
        Q: ArrayLike | None = None,
        dt: float | None = None,
        nominal: Mapping[str, float] | None = None,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        disturbances: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> Family:
        """The family whose matrices at the points of ``axes`` are given.

        Shapes: ``A`` ``(grid..., nx, nx)``, ``B`` ``(grid..., nx, nu)``, ``G``
        ``(grid..., nx, nw)`` (the identity), ``C`` ``(grid..., ny, nx)``, ``Q``
        ``(grid..., nw, nw)`` (the identity), ``R`` ``(grid..., ny, ny)``, the grid in the
        order of ``axes``. ``dt`` in seconds makes it discrete. ``nominal`` is the middle
        of each axis unless stated.

        >>> import numpy as np, pymmae
        >>> k = np.linspace(0.5, 2.0, 7)
        >>> A = np.zeros((7, 2, 2)); A[:, 0, 1] = 1; A[:, 1, 0] = -k; A[:, 1, 1] = -0.3
        >>> family = pymmae.Family.from_stacked({"k": k}, A=A, C=[[1, 0]], R=[[0.01]])
        >>> scenario = pymmae.Scenario({"bank": {"models": {"k": [0.5, 1.0]}}}, family=family)
        >>> float(scenario.plant(k=0.625)["A"][1, 0])      # between two points
        -0.625
        """
        if not axes:
            raise InputError("axes is empty: name at least one parameter", "empty")
        values = {name: _axis(name, axis) for name, axis in axes.items()}
        a, c = convert("A", A), convert("C", C)
        if a.ndim < 2 or c.ndim < 2:
            raise InputError("A and C: give matrices, rows by columns", "shape")
        nx, ny = a.shape[-1], c.shape[-2]
        b = np.zeros((nx, 0)) if B is None else convert("B", B)
        g = np.eye(nx) if G is None else convert("G", G)
        nu, nw = b.shape[-1], g.shape[-1]
        q = np.eye(nw) if Q is None else convert("Q", Q)
        names = (
            _names("states", states, "x", nx),
            _names("inputs", inputs, "u", nu),
            _names("disturbances", disturbances, "w", nw),
            _names("outputs", outputs, "y", ny),
        )
        middle = {name: float(axis[len(axis) // 2]) for name, axis in values.items()}
        for name, value in (nominal or {}).items():
            if name not in middle:
                raise InputError(f"nominal: no parameter is called '{name}'", "unknown_parameter")
            middle[name] = float(value)
        matrices = dict(zip(_LETTERS, (a, b, g, c, q, convert("R", R))))
        return cls(values, middle, names, None if dt is None else float(dt), matrices)

    @classmethod
    def from_function(
        cls,
        function: Callable[..., Mapping[str, ArrayLike]],
        axes: Mapping[str, ArrayLike],
        *,
        models: Mapping[str, ArrayLike] | None = None,
        **others: Any,
    ) -> Family:
        """The family that ``function`` gives, called once at each point of the grid.

        ``function(**values)`` returns a mapping with ``A``, ``C``, ``R`` and perhaps
        ``B``, ``G``, ``Q``. ``models`` are values that join the axes, so that models stand
        at points and are exact. Other arguments as :meth:`from_stacked`.

        >>> import numpy as np, pymmae
        >>> def spring(k):
        ...     return {"A": [[0, 1], [-k, -0.3]], "C": [[1, 0]], "R": [[0.01]]}
        >>> grid = np.linspace(0.5, 2.0, 31)
        >>> family = pymmae.Family.from_function(spring, {"k": grid}, models={"k": [0.73]})
        >>> len(family.axes["k"])
        32
        """
        if not callable(function):
            raise DTypeError("function: give a function of the parameters", "dtype")
        joined = {}
        for name, axis in axes.items():
            extra = (models or {}).get(name)
            values = _axis(name, axis)
            if extra is not None:
                values = np.union1d(values, convert(f"models of {name}", extra))
            joined[name] = values
        room("the family", 64 * int(np.prod([float(len(v)) for v in joined.values()])))
        points = itertools.product(*(axis.tolist() for axis in joined.values()))
        rows: dict[str, list[Array]] = {}
        for count, point in enumerate(points):
            made = function(**dict(zip(joined, point)))
            if not isinstance(made, Mapping):
                raise DTypeError("function: return a dictionary of matrices", "dtype")
            for letter, matrix in made.items():
                if letter not in _LETTERS:
                    raise InputError(f"function: '{letter}' is none of A, B, G, C, Q, R", "range")
                rows.setdefault(letter, []).append(convert(letter, matrix))
            if any(len(all_) != count + 1 for all_ in rows.values()):
                raise InputError("function: return the same letters everywhere", "shape")
        shape = tuple(len(axis) for axis in joined.values())
        stacked: dict[str, Any] = {}
        for letter, matrices in rows.items():
            if len({m.shape for m in matrices}) != 1:
                raise InputError(f"function: {letter} has different shapes", "shape")
            stacked[letter] = np.array(matrices).reshape(shape + matrices[0].shape)
        for letter in ("A", "C", "R"):
            if letter not in stacked:
                raise InputError(f"function: it returns no {letter}", "empty")
        return cls.from_stacked(joined, **stacked, **others)

    def _raw(self) -> dict[str, Any]:
        """As the engine takes it."""
        axes = [(name, axis.tolist(), self.nominal[name]) for name, axis in self.axes.items()]
        # an array without columns holds nothing to convert
        return {"axes": axes, "names": self.names, "dt": self.dt, **self.matrices}


def _axis(name: str, axis: ArrayLike) -> Array:
    values = convert(f"axis of {name}", axis)
    if values.ndim != 1 or not np.all(np.isfinite(values)) or np.any(np.diff(values) <= 0):
        raise InputError(f"axis of {name}: give finite values that rise", "range")
    return values


def _names(what: str, given: Sequence[str] | None, letter: str, n: int) -> list[str]:
    if given is None:
        return [f"{letter}{i + 1}" for i in range(n)]
    names = list(given)
    if len(names) != n or len(set(names)) != n or not all(isinstance(v, str) for v in names):
        raise InputError(f"{what}: give {n} different names", "shape")
    return names
