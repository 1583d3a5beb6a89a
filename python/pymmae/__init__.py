"""Multiple-model adaptive estimation: the engine `mmae` for whole arrays.

Equations on stacked arrays: :func:`care`, :func:`dare`, :func:`lyap`, :func:`sylvester`,
:func:`riccati_ode`. Scenarios (:class:`Scenario`, :class:`Family`) and what can be asked of
them, as labelled datasets: :func:`eip`, :func:`place`, :func:`estimate`, :func:`run`,
:func:`monte_carlo`, :func:`adaptive`; :func:`sweep` for grids larger than a machine. Pictures:
``pymmae.plot``.

All engine work runs without the interpreter lock, on ``threads`` threads, and stops at
Ctrl-C. Results have the same bits for any number of threads. What goes wrong is a subclass
of :class:`Error`.

Arguments are real arrays: float64, or float32 and integers, which are promoted; of any
strides. They are never modified. An array that nobody can write to (``flags.writeable`` is
false, and so for the array that it is a view of) and that is float64 in C order is used
where it is; others are copied once, before the lock is released.
"""

from ._core import CPU_TIER, VERSION
from ._sweep import Sweep, sweep
from .errors import (
    Cancelled,
    DTypeError,
    Error,
    FileError,
    InputError,
    InternalError,
    LimitError,
    NumericalError,
    ScenarioError,
    SweepError,
)
from .family import Family
from .observers import adaptive
from .runs import estimate, monte_carlo, run
from .scenario import Scenario, ScenarioWarning
from .solvers import Solutions, care, dare, lyap, riccati_ode, sylvester
from .study import Placement, eip, place

__version__ = VERSION

__all__ = [
    "CPU_TIER",
    "Cancelled",
    "DTypeError",
    "Error",
    "Family",
    "FileError",
    "InputError",
    "InternalError",
    "LimitError",
    "NumericalError",
    "Placement",
    "Scenario",
    "ScenarioError",
    "ScenarioWarning",
    "Solutions",
    "Sweep",
    "SweepError",
    "VERSION",
    "adaptive",
    "care",
    "dare",
    "eip",
    "estimate",
    "lyap",
    "monte_carlo",
    "place",
    "riccati_ode",
    "run",
    "sweep",
    "sylvester",
]
