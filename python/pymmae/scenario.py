"""Scenarios: a parameterised plant, its surroundings, a bank of models, a study."""

from __future__ import annotations

import copy
import os
import tomllib
import warnings
from collections.abc import Mapping
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from . import _core, _toml
from .errors import DTypeError, FileError, InputError, LimitError
from .family import Family

#: A scenario, its tables, or the path of its file.
ScenarioLike = Union["Scenario", Mapping[str, Any], str, "os.PathLike[str]"]

_LIMIT = 8 << 20


class ScenarioWarning(UserWarning):
    """What is odd about a scenario but no error."""


class Scenario:
    """A scenario, checked: the same language from a file, a text or dictionaries.

    The keys are those of scenario files, described in the guide of the crate, page
    "scenario"; arrays of NumPy stand for lists. Matrix entries may be expressions of
    ``plant.parameters``. With ``family`` the plants are given by matrices instead, and
    there is no ``"plant"``. ``units`` gives the units of parameters, states, inputs and
    outputs by name; results carry them.

    A scenario never changes: :meth:`updated` makes another. It can be pickled.

    >>> import pymmae
    >>> spring = pymmae.Scenario({
    ...     "plant": {
    ...         "time": "continuous", "states": ["x", "v"], "outputs": ["x"],
    ...         "disturbances": ["force"], "A": [[0, 1], ["-k", -0.3]], "G": [0, 1],
    ...         "C": [1, 0], "Q": 1, "R": 0.01, "parameters": {"k": 1.0},
    ...     },
    ...     "bank": {"models": {"k": [0.5, 2.0]}},
    ... }, units={"x": "m", "k": "1/s^2"})
    >>> spring.states, spring.parameters
    (('x', 'v'), {'k': 1.0})
    >>> float(spring.plant(k=3.0)["A"][1, 0])
    -3.0
    """

    def __init__(
        self,
        tables: Mapping[str, Any],
        *,
        family: Family | None = None,
        name: str = "scenario",
        units: Mapping[str, str] | None = None,
    ) -> None:
        if not isinstance(tables, Mapping):
            raise DTypeError("tables: give a dictionary of tables, or use Scenario.load", "dtype")
        tables = dict(tables)
        tables.setdefault("format", 1)
        self._build(_toml.dumps(tables), name, family, units, quiet=False)

    @classmethod
    def parse(
        cls,
        text: str,
        *,
        family: Family | None = None,
        name: str = "scenario",
        units: Mapping[str, str] | None = None,
    ) -> Scenario:
        """The scenario ``text``, TOML; messages call it ``name``."""
        if not isinstance(text, str):
            raise DTypeError("text: give a str, or a path to Scenario.load", "dtype")
        self = cls.__new__(cls)
        self._build(text, name, family, units, quiet=False)
        return self

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        family: Family | None = None,
        units: Mapping[str, str] | None = None,
    ) -> Scenario:
        """The scenario in the file at ``path``.

        Raises ``FileError`` if it cannot be read, ``LimitError`` over 8 MiB,
        ``ScenarioError`` naming file, line, column, key and remedy of all that is wrong.
        """
        if not isinstance(path, (str, os.PathLike)):
            raise DTypeError("path: give the path of a file", "dtype")
        name = os.fspath(path)
        try:
            with open(name, "rb") as file:
                data = file.read(_LIMIT + 1)
        except (OSError, ValueError) as error:
            raise FileError(f"{name}: {error}: check the path", "read") from None
        if len(data) > _LIMIT:
            raise LimitError(f"{name}: over the limit of {_LIMIT} bytes: pass arrays", "limit")
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise InputError(f"{name}: {error}: save it as UTF-8", "scenario") from None
        return cls.parse(text, family=family, name=name, units=units)

    def _build(
        self,
        text: str,
        name: str,
        family: Family | None,
        units: Mapping[str, str] | None,
        quiet: bool,
    ) -> None:
        if family is not None and not isinstance(family, Family):
            raise DTypeError("family: give a pymmae.Family", "dtype")
        self._text, self._name, self._family = text, name, family
        self._units = dict(units or {})
        self._core = _core.Scenario(name, text, None if family is None else family._raw())
        self._about = self._core.about()
        if not quiet:
            for w in self._about["warnings"]:
                place = f"{w['file']}:{w['line']}:{w['column']}: {w['key']}"
                text = f"{place}: {w['message']}: {w['remedy']}"
                warnings.warn(text, ScenarioWarning, stacklevel=4)

    @property
    def text(self) -> str:
        """The text, TOML."""
        return self._text

    @property
    def name(self) -> str:
        """What messages call it: the path of its file."""
        return self._name

    @property
    def tables(self) -> dict[str, Any]:
        """The tables as dictionaries, a copy."""
        return tomllib.loads(self._text.removeprefix("\ufeff"))

    @property
    def family(self) -> Family | None:
        """The plants, if they are given by matrices."""
        return self._family

    @property
    def units(self) -> dict[str, str]:
        """Units by name, a copy."""
        return dict(self._units)

    @property
    def title(self) -> str | None:
        """The title, if it has one."""
        title: str | None = self._about["title"]
        return title

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the plant's states."""
        return tuple(self._about["states"])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the plant's inputs."""
        return tuple(self._about["inputs"])

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the plant's outputs."""
        return tuple(self._about["outputs"])

    @property
    def parameters(self) -> dict[str, float]:
        """Nominal values of the parameters, a copy."""
        return dict(self._about["parameters"])

    @property
    def observers(self) -> tuple[str, ...]:
        """Names of the adaptive observers, see :func:`pymmae.adaptive`."""
        return tuple(self._about["observers"])

    def plant(self, **values: float) -> dict[str, NDArray[np.float64]]:
        """``A, B, G, C, Q, R`` at the given parameter values, nominal ones elsewhere.

        Raises ``InputError`` for an unknown parameter and for a plant that cannot be built.
        """
        return self._core.plant([(name, float(value)) for name, value in values.items()])

    def updated(self, changes: Mapping[str, Any]) -> Scenario:
        """Another scenario: ``changes`` replace values by key, tables are merged.

        >>> import pymmae
        >>> bank = pymmae.Scenario({"plant": {"family": "tracker"},
        ...                         "bank": {"models": {"rho": [0.9, 1.0]}}})
        >>> bank.updated({"weighting": {"law": "zhang1"}}).tables["weighting"]
        {'law': 'zhang1'}
        """
        tables = _merged(self.tables, changes)
        return Scenario(tables, family=self._family, name=self._name, units=self._units)

    def __repr__(self) -> str:
        title = f", title={self.title!r}" if self.title else ""
        return f"Scenario(name={self._name!r}{title})"

    def __reduce__(self) -> tuple[Any, ...]:
        return (_restored, (self._text, self._name, self._family, self._units))


def _restored(text: str, name: str, family: Family | None, units: dict[str, str]) -> Scenario:
    self = Scenario.__new__(Scenario)
    self._build(text, name, family, units, quiet=True)
    return self


def _merged(tables: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    out = copy.copy(tables)
    for key, value in changes.items():
        old = out.get(key)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        out[key] = _merged(dict(old), value) if both else value  # type: ignore[arg-type]
    return out


def scenario_of(value: ScenarioLike) -> Scenario:
    """What a function was given as its scenario."""
    if isinstance(value, Scenario):
        return value
    if isinstance(value, Mapping):
        return Scenario(value)
    return Scenario.load(value)
