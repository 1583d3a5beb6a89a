"""What can go wrong, one class a kind; every message ends with the remedy.

Each is a subclass of :class:`Error` and of the built-in exception that fits, so that
``except ValueError`` works as anywhere. ``code`` is a short name of the cause that stays
the same across versions: ``not_detectable``, ``shape``, ``limit`` and so on.

>>> import numpy as np, pymmae
>>> try:
...     pymmae.care(np.eye(2), np.eye(2), np.eye(2), np.array([[1.0, 2.0], [0.0, 1.0]]))
... except ValueError as error:
...     print(type(error).__name__, error.code)
InputError not_symmetric
"""

from __future__ import annotations

from typing import Any


class Error(Exception):
    """Whatever this package raises, but for ``KeyboardInterrupt``."""

    def __init__(self, message: str, code: str = "error") -> None:
        super().__init__(message)
        self.message = message
        self.code = code
        #: Of scenarios: dictionaries with file, line, column, key, message, remedy.
        self.diagnostics: list[dict[str, Any]] = []

    def __str__(self) -> str:
        return self.message

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.message, self.code), {"diagnostics": self.diagnostics})


class InputError(Error, ValueError):
    """A value, a shape or a combination of settings that cannot be used."""


class DTypeError(Error, TypeError):
    """An argument of a type that holds no plain real numbers."""


class ScenarioError(InputError):
    """A scenario that cannot be used; ``diagnostics`` tell every place."""


class NumericalError(Error, ArithmeticError):
    """A well-formed problem without a solution that could be verified."""


class LimitError(Error, MemoryError):
    """Something that does not fit in memory; nothing was allocated."""


class FileError(Error, OSError):
    """A file that cannot be read or written."""


class Cancelled(Error):
    """Work that was told to stop."""


class InternalError(Error, RuntimeError):
    """A fault of the engine itself: please report it."""


class SweepError(Error, RuntimeError):
    """A sweep some of whose tasks came to nothing.

    ``failed`` maps the number of each such task to the reason; ``result`` holds the rest.
    """

    def __init__(self, message: str, code: str = "sweep") -> None:
        super().__init__(message, code)
        self.failed: dict[int, str] = {}
        self.result: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        state = {"diagnostics": self.diagnostics, "failed": self.failed, "result": self.result}
        return (type(self), (self.message, self.code), state)
