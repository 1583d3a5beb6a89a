"""EIP sets: which model each plant is identified as, and models for the sets one wants."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._label import Variables, attrs, dataset, models, own_names, texts
from ._progress import Progress, reporting
from .errors import InputError
from .scenario import ScenarioLike, scenario_of

if TYPE_CHECKING:
    import xarray as xr

_UNITS = {"ito": "1/s", "baram": "1", "identity": "squared units of the output"}
_NAMES = {"upsilon", "error", "winner", "margin", "status", "boundary", "interval", "label"}


def eip(
    scenario: ScenarioLike,
    *,
    threads: int | None = None,
    progress: Progress = None,
) -> xr.Dataset:
    """Sets of equivalently identified plants of a scenario.

    .. code-block:: text

        Upsilon_i(kappa) = 1/2 tr(R^-1 E[eps_i eps_i'])    winner(kappa) = argmin_i Upsilon_i(kappa)

    Takes what ``[bank]`` and ``[eip]`` of the scenario say. Dimensions: one a parameter of
    the grid (and ``delay`` where there are several), ``model``. Variables: ``upsilon``
    and its ``error``, ``winner`` (index of a model, -1 without), ``margin``, ``status``
    (0 decided, 1 unstable, 2 cannot be built, 3 undecided); with one parameter the
    boundaries (dimension ``boundary``) and the sets as intervals (dimension ``interval``);
    ``upsilon_at_nominals`` and ``pseudo_norm``. The attribute ``sha256`` is the digest of
    the ``eip.json`` that the command writes for the same study.

    Units: Upsilon is a rate (1/s) under ``ito``, a number under ``baram``, squared units of
    the output under ``identity``.

    Source: Hassani, Aguiar, Pascoal, Athans (2009), eqs. (18)-(21).

    Raises ``ScenarioError`` where the scenario lacks something, ``NumericalError`` if no
    model can be designed, ``LimitError`` over ``eip.memory_limit``. Models and plants that
    fail by themselves are flagged.

    >>> import pymmae
    >>> sets = pymmae.eip({"plant": {"family": "pendulum"},
    ...                    "bank": {"models": {"L": [1.025, 1.287, 1.526, 1.778]}},
    ...                    "eip": {"grid": {"L": {"from": 0.9, "to": 1.9, "points": 41}}}})
    >>> int(sets.winner.sel(L=1.2, method="nearest"))
    1
    >>> bool(abs(sets.boundary[0] - 1.153616065) < 1e-9)
    True
    """
    taken = scenario_of(scenario)
    with reporting(progress, "plant") as tell:
        raw = _core.eip(taken._core, threads, tell)
    return _labelled(raw, taken.units)


def _labelled(raw: dict[str, Any], units: dict[str, str]) -> xr.Dataset:
    own = own_names([name for name, _ in raw["axes"]], _NAMES)
    grid = tuple(len(values) for _, values in raw["axes"])
    delays = raw["delays"]
    several = len(delays) > 1
    dims = (("delay",) if several else ()) + tuple(own)
    shape = ((len(delays),) if several else ()) + grid
    unit = _UNITS[raw["convention"]]
    pairs = (*dims, "model")
    flags = {"flag_values": [0, 1, 2, 3], "flag_meanings": "decided unstable failed undecided"}
    one = {name: raw[name].reshape(shape) for name in ("winner", "margin", "status")}
    each = {name: raw[name].reshape((*shape, -1)) for name in ("upsilon", "error")}
    variables: Variables = {
        "upsilon": (pairs, each["upsilon"], attrs(unit, "energy of the output error")),
        "error": (pairs, each["error"], attrs(unit, "error estimate of upsilon")),
        "winner": (dims, one["winner"], attrs("1", "model of smallest upsilon, -1 for none")),
        "margin": (dims, one["margin"], attrs(unit, "upsilon of the second less the first")),
        "status": (dims, one["status"], attrs("1", "what is known of the plant", **flags)),
        "upsilon_at_nominals": (
            ("at_model", "model"),
            raw["at_nominals"],
            attrs(unit, "upsilon with the plant at the nominal value of at_model"),
        ),
        "pseudo_norm": (
            ("at_model", "model"),
            raw["pseudo_norm"],
            attrs(unit, "difference of upsilon at the nominal value of at_model"),
        ),
        "duplicate_of": ("model", raw["duplicate_of"], attrs("1", "earlier twin, -1 for none")),
        "failure": ("model", _messages(raw["failures"], len(raw["labels"]))),
    }
    if len(own) == 1:
        parameter = attrs(units.get(own[0], ""), f"boundary of {own[0]}")
        variables |= _lists("boundary", raw["boundaries"], _BOUNDARY, several, delays, parameter)
        variables |= _lists("interval", raw["intervals"], _INTERVAL, several, delays, parameter)
    if several and len(own) == 1:
        mask = np.zeros((len(raw["undecidable"]), len(raw["labels"])), dtype=bool)
        for k, (_, _, who) in enumerate(raw["undecidable"]):
            mask[k, who] = True
        ends = np.array([u[:2] for u in raw["undecidable"]]).reshape(-1, 2)
        variables["undecidable_from"] = ("undecidable", ends[:, 0])
        variables["undecidable_to"] = ("undecidable", ends[:, 1])
        variables["undecidable_models"] = (("undecidable", "model"), mask)
    checks: Any = ("delay",) if several else ()
    for name in ("route_difference", "checked_pairs", "replaced"):
        data = raw[name].astype(float if name == "route_difference" else np.int64)
        variables[name] = (checks, data if several else data[0])
    coords = models(raw, units)
    for name, (_, values) in zip(own, raw["axes"]):
        coords[name] = (name, values, attrs(units.get(name, ""), f"parameter {name} of the plant"))
    delay = delays if several else delays[0]
    coords["delay"] = (checks, delay, attrs("s", "actuator delay"))
    facts = {
        "title": raw["title"],
        "convention": raw["convention"],
        "method": raw["method"],
        "sha256": hashlib.sha256(raw["json"].encode()).hexdigest(),
    }
    return dataset(variables, coords, facts)


_BOUNDARY = (("boundary", 1), ("boundary_uncertainty", 2), ("left", 3), ("right", 4))
_INTERVAL = (("interval_model", 1), ("interval_from", 2), ("interval_to", 3))


def _lists(
    dim: str,
    rows: Sequence[Sequence[Any]],
    columns: Sequence[tuple[str, int]],
    several: bool,
    delays: NDArray[np.float64],
    parameter: dict[str, Any],
) -> Variables:
    """Rows of a list as variables along ``{dim}_number``; the first column numbers the delay.

    A variable called as its dimension would become its coordinate.
    """
    out: Variables = {}
    for name, at in columns:
        whole = name in ("left", "right", "interval_model")
        data = np.array([row[at] for row in rows], dtype=np.int64 if whole else np.float64)
        out[name] = (f"{dim}_number", data, attrs("1", name) if whole else parameter)
    if several:
        data = np.array([delays[row[0]] for row in rows], dtype=np.float64)
        out[f"{dim}_delay"] = (f"{dim}_number", data, attrs("s", "actuator delay"))
    return out


def _messages(failures: Sequence[tuple[int, str]], count: int) -> Any:
    out = [""] * count
    for index, message in failures:
        out[index] = message
    return texts(out)


@dataclass(frozen=True, eq=False)
class Placement:
    """Nominal values and what they are worth, see :func:`place`."""

    #: Name of the parameter.
    parameter: str
    #: First and last value of the parameter.
    domain: tuple[float, float]
    #: The nominal values.
    nominals: NDArray[np.float64]
    #: The edges that were asked for.
    wanted: NDArray[np.float64]
    #: The boundaries that a study with these nominal values has.
    edges: NDArray[np.float64]
    #: Excess at the start, the edges and the end of the domain.
    excess: NDArray[np.float64]
    #: Derivative of each nominal value with the first, as the edges stay.
    sensitivity: NDArray[np.float64]
    #: The first nominal values for which each lies in its own cell.
    feasible: tuple[float, float]


def place(
    scenario: ScenarioLike,
    cells: int | None = None,
    *,
    edges: Sequence[float] | None = None,
    excess: float | None = None,
    anchor: float | None = None,
    threads: int | None = None,
) -> Placement:
    """Nominal values of one parameter whose EIP sets are the cells wanted.

    .. code-block:: text

        Upsilon_i(e) = Upsilon_{i+1}(e)   at every edge e between cells i and i+1

    ``cells``: so many of equal width (as many as the bank has models unless stated);
    ``edges``: cells between these inner edges; ``excess``: as few as keep the excess
    ``min_i Upsilon_i(kappa) - Upsilon_kappa(kappa)`` below this. The first nominal value is
    ``anchor``, or the one with the smallest worst excess. All in units of the parameter.

    Source: Hassani, Aguiar, Pascoal, Athans (2009), section III.

    Raises ``InputError`` for several parameters, edges that do not rise inside the grid, or
    cells that no nominal values have.

    >>> import pymmae
    >>> placed = pymmae.place({"plant": {"family": "pendulum"},
    ...                        "bank": {"models": {"L": [1.4]}},
    ...                        "eip": {"grid": {"L": {"from": 0.9, "to": 1.9, "points": 41}}}}, 4)
    >>> bool(max(abs(placed.edges - [1.15, 1.4, 1.65])) < 1e-9)
    True
    """
    if sum(x is not None for x in (cells, edges, excess)) > 1:
        raise InputError("give one of cells, edges and excess", "conflict")
    taken = scenario_of(scenario)
    list_ = None if edges is None else [float(e) for e in edges]
    raw = _core.place(taken._core, cells, list_, excess, anchor, threads)
    raw["domain"], raw["feasible"] = tuple(raw["domain"]), tuple(raw["feasible"])
    return Placement(**raw)
