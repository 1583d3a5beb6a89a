"""Adaptive observers: states and parameters together."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._label import Variables, attrs, channels, dataset, texts, unit_list
from ._progress import Progress, reporting
from .errors import InputError
from .scenario import Scenario, ScenarioLike, ScenarioWarning, scenario_of

if TYPE_CHECKING:
    import xarray as xr

_ONE = "1"
_STATE, _OUTPUT = "units of the state", "units of the output"
_PARAMETER = "units of the parameter"


def adaptive(
    scenario: ScenarioLike,
    y: ArrayLike | None = None,
    u: ArrayLike | None = None,
    *,
    t: ArrayLike | None = None,
    observer: str | None = None,
    case: str | None = None,
    K: ArrayLike | None = None,
    forgetting: ArrayLike | None = None,
    P0: ArrayLike | None = None,
    theta0: ArrayLike | None = None,
    trials: int | None = None,
    seed: int | None = None,
    truth: Mapping[str, float] | None = None,
    every: int | None = None,
    tolerance: float = 0.02,
    threads: int | None = None,
    progress: Progress = None,
) -> xr.Dataset:
    """States and parameters of a plant that is linear in what is unknown.

    .. code-block:: text

        plant      x' = A x + sum theta_i g_i + f,                       y = C x
        observer   x_hat' = A x_hat + sum theta_hat_i g_i + f + K (y - C x_hat)
        filters    psi_i' = (A - K C) psi_i + g_i,   psi_0' = (A - K C) psi_0 + K y + f
        theta_hat  minimizes  sum_k e^(-forgetting (t - t_k)) |y_k - C (Psi_k theta + psi_0k)|^2

    ``scenario`` describes the observer under ``[adaptive]`` (guide, pages "adaptive" and
    "scenario"), as ``mmae run`` and ``mmae estimate`` take it. Without ``y`` its plant
    ``[adaptive.truth]`` is simulated: every case (or the one called ``case``) and trial, with
    ``trials``, ``seed`` and ``every`` those of ``[run]`` unless stated and parameters of the
    plant replaced by ``truth``; trial i has the same noise whatever the number of trials.
    With ``y``, shape ``(time, output)`` and NaN for what is missing, and ``u``, shape ``(time,
    input)``, the observer follows recorded data, one row each ``dt`` seconds or at the times
    ``t`` (steps of whole multiples of ``dt``; in between outputs are missing and inputs run
    straight). With a dimension ``record`` in front of ``y`` many records are followed at
    once; ``u`` may have it too.

    ``observer`` is the name of one of several, else the first that can be used is taken.
    ``K`` (state by output), ``forgetting`` in 1/s, ``P0`` and ``theta0`` (parameter) replace
    what the scenario says. Each may have a dimension ``item`` in front: a grid, all of whose
    observers see the same data. ``every`` so many samples a report, and the end (0: the end
    alone; on data each sample unless stated). A parameter counts as settled while it drifts
    by less than ``tolerance`` over a window and is on no bound.

    Dimensions ``case`` (with several), ``item`` (of a grid), ``trial`` or ``record`` (of
    several), ``time``, ``parameter``, ``state``, ``output``. Variables ``theta_hat``,
    ``theta_std``, ``correlation``, ``at_bound``, ``x_hat``, ``x_std``; of the last complete
    window ``window`` (its end), ``condition`` of the excitation, ``residual`` (root mean
    square) and ``drift``; ``settled``; ``y``; ``theta`` and ``x`` of the plant, where they
    are known. ``rank`` and ``singular`` tell how far the output tells the parameters apart,
    ``failure`` (empty where all is well) why an item cannot be used or that it ran away. If
    the scenario names ``physical`` parameters behind ``theta``: ``phi_hat`` and ``phi_std`` at
    the end, ``phi`` of the plant, ``phi_failure``.

    Standard deviations are those of white noise on ``y``, from ``P``; noise on measured
    columns biases ``theta_hat``, of which they know nothing.

    Source: Liu, Peng, A state and parameter identification scheme for linearly parameterized
    systems, eqs. (1), (3), (6)-(11), in the reading ``zhang`` unless the scenario states another.

    Raises ``ScenarioError`` without ``[adaptive]``, and for an observer that is unstable, not
    observable or not identifiable; ``InputError`` for arrays that do not fit;
    ``NumericalError`` if all items are unusable or every course ran away; ``LimitError`` for
    courses of more than a gigabyte. In a grid a bad item is flagged, the others are as they
    would be alone.

    >>> import numpy as np, pymmae
    >>> motor = pymmae.Scenario({                                # x' = a x + b u, y = x
    ...     "adaptive": {
    ...         "dt": 0.01, "inputs": ["u"], "outputs": ["y"],
    ...         "observers": {"motor": {
    ...             "states": ["x"], "A": 0, "C": 1, "K": 2, "P0": 1e8,
    ...             "theta": {"a": {"entry": ["x", "x"]}, "b": {"column": "u"}}}}}})
    >>> time = 0.01 * np.arange(2000)
    >>> u = np.sin(time)
    >>> y = u - np.cos(time) + np.exp(-time)                     # a = -1, b = 2
    >>> found = pymmae.adaptive(motor, y[:, None], u[:, None], K=[[[1.0]], [[4.0]]])
    >>> bool(abs(found.theta_hat.isel(time=-1) - [-1, 2]).max() < 1e-3)   # whatever K is
    True
    """
    taken = scenario_of(scenario)
    grid = {"K": K, "forgetting": forgetting, "P0": P0, "theta0": theta0}
    if y is None:
        _none("simulated data", u=u, t=t)
        changes = [(name, float(value)) for name, value in (truth or {}).items()]
        with reporting(progress, "trial") as tell:
            raw = _core.adaptive_trials(
                taken._core, observer, grid, case, changes, trials, seed, every, tolerance,
                threads, tell,
            )  # fmt: skip
        return _simulated(taken, raw)
    _none("recorded data", case=case, trials=trials, seed=seed, truth=truth)
    with reporting(progress, "record") as tell:
        raw = _core.adaptive_records(
            taken._core, observer, grid, y, u, t, 1 if every is None else every, tolerance,
            threads, tell,
        )  # fmt: skip
    return _pack(taken, raw, "record", np.ndim(y) == 3, {})


def _none(what: str, **given: Any) -> None:
    for name, value in given.items():
        if value is not None:
            raise InputError(f"{name} has no meaning for {what}: leave it out", "conflict")


def _dropping(kept: bool) -> Callable[[Any], Any]:
    """What takes the first dimension off, unless it is kept."""
    return lambda data: data if kept else data[0]


def _simulated(taken: Scenario, raw: dict[str, Any]) -> xr.Dataset:
    several = len(raw["cases"]) > 1
    cases = ("case",) if several else ()
    of = _dropping(several)
    common = raw["plant_states"] == raw["states"]
    states = "state" if common else "plant_state"
    x = attrs(_STATE, "state of the plant")
    extra: Variables = {
        "x": ((*cases, "time", states), of(raw["x"]), x),
        "truth_steps": (cases, of(raw["truth_steps"]), attrs(_ONE, "Runge-Kutta steps a sample")),
        "truth_error": (cases, of(raw["truth_error"]), attrs(_ONE, "relative error of the plant")),
    }
    for name, key, dim in (("theta", "theta", "parameter"), ("phi", "physical_theta", "physical")):
        if raw[key] is not None:
            data = np.reshape(raw[key], (len(raw["cases"]), -1))
            about = attrs(_PARAMETER, "true value of the parameter")
            extra[name] = ((*cases, dim), of(data), about)
    result = _pack(taken, raw, "trial", True, extra)
    if not common:
        units = channels("plant_state", raw["plant_states"], len(raw["plant_states"]), taken.units)
        result = result.assign_coords(units)
    # beyond the integers of some file formats
    return result.assign_attrs(seed=str(raw["seed"]), trials=raw["trials"])


#: Variables with all leading dimensions: their own dimensions, units, meaning.
_COURSES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "theta_hat": (("parameter",), _PARAMETER, "estimate of the parameter"),
    "theta_std": (("parameter",), _PARAMETER, "standard deviation of the estimate"),
    "correlation": (("parameter", "with_parameter"), _ONE, "correlation of the estimates"),
    "at_bound": (("parameter",), _ONE, "the parameter stands on a bound"),
    "x_hat": (("state",), _STATE, "estimate of the state"),
    "x_std": (("state",), _STATE, "its standard deviation as far as it comes from theta_hat"),
    "window": ((), "s", "end of the last complete window"),
    "condition": ((), _ONE, "condition of the excitation over the window"),
    "residual": ((), "units of the output over sqrt(R)", "root mean square of the residuals"),
    "drift": ((), _ONE, "largest relative change of a parameter over the window"),
    "settled": ((), _ONE, "the parameters have settled"),
}


def _pack(
    taken: Scenario, raw: dict[str, Any], source: str, sources: bool, extra: Variables
) -> xr.Dataset:
    """Arrays with dimensions (case, item, source, time, ..), less those that are not wanted."""
    for name, why in raw["passed"]:
        text = f"observer {name} cannot be used: {why}"
        warnings.warn(text, ScenarioWarning, stacklevel=4)
    several, stacked = len(raw.get("cases", ())) > 1, raw["stacked"]
    kept = [("case", several), ("item", stacked), (source, sources)]
    lead = tuple(dim for dim, wanted in kept if wanted)
    front = tuple(slice(None) if wanted else 0 for _, wanted in kept)
    items: tuple[str, ...] = ("item",) if stacked else ()
    of = _dropping(stacked)
    variables: Variables = {
        name: ((*lead, "time", *own), raw[name][front], attrs(units, long))
        for name, (own, units, long) in _COURSES.items()
    }
    seen = tuple(dim for dim in lead if dim != "item")
    measured = raw["y"][front[0], front[2]]
    variables["y"] = ((*seen, "time", "output"), measured, attrs(_OUTPUT, "measurement"))
    unusable = np.array([text or "" for text in raw["failures"]], dtype=object)
    ran_away = np.where(raw["sound"], "", "ran away: bound theta with min and max, or lower P0")
    failure = np.where(unusable[:, None] != "", unusable[:, None], ran_away)
    told = texts(failure.ravel().tolist()).reshape(failure.shape)[front]
    variables["failure"] = (lead, told, {"long_name": "why there is no result"})
    variables["rank"] = (
        items, of(raw["rank"]), attrs(_ONE, "combinations of the parameters that y shows")
    )  # fmt: skip
    variables["singular"] = (
        (*items, "direction"),
        of(raw["singular"]),
        attrs(_ONE, "relative singular values of the sensitivities of y to the parameters"),
    )
    variables["K"] = ((*items, "state", "output"), of(raw["K"]), attrs(_ONE, "observer gain"))
    variables["P0"] = ((*items, "parameter"), of(raw["P0"]), attrs(_ONE, "diagonal of P(0)"))
    start = attrs(_PARAMETER, "estimate at the start")
    variables["theta0"] = ((*items, "parameter"), of(raw["theta0"]), start)
    variables |= extra
    units, names = taken.units, raw["parameters"]
    coords: Variables = {
        "time": ("time", raw["t"], attrs("s", "time")),
        "parameter": ("parameter", texts(names)),
        "with_parameter": ("with_parameter", texts(names)),
        "parameter_units": ("parameter", unit_list(names, units)),
    }
    # a coordinate where it tells items apart; of one observer it would be in the way
    told_by = coords if stacked else variables
    told_by["forgetting"] = (items, of(raw["forgetting"]), attrs("1/s", "rate of forgetting"))
    coords |= channels("state", raw["states"], len(raw["states"]), units)
    coords |= channels("output", raw["outputs"], len(raw["outputs"]), units)
    if raw["physical"]:
        behind = raw["physical_names"]
        own = (*lead, "physical")
        value = attrs(_PARAMETER, "physical parameter behind theta_hat at the end")
        variables["phi_hat"] = (own, raw["physical_value"][front], value)
        deviation = attrs(_PARAMETER, "its standard deviation")
        variables["phi_std"] = (own, raw["physical_std"][front], deviation)
        reasons = texts(raw["physical_failure"]).reshape(raw["physical_value"].shape[:3])
        variables["phi_failure"] = (lead, reasons[front], {"long_name": "why there is none"})
        coords["physical"] = ("physical", texts(behind))
        coords["physical_units"] = ("physical", unit_list(behind, units))
    if several:
        coords["case"] = ("case", texts(raw["cases"]))
    if stacked:
        count = len(raw["forgetting"])
        coords["item"] = ("item", np.arange(count), attrs(_ONE, "index of the item"))
    if sources:
        count = raw["y"].shape[1]
        coords[source] = (source, np.arange(count), attrs(_ONE, f"number of the {source}"))
    facts = {
        "title": raw["title"],
        "observer": raw["observer"],
        "reading": raw["reading"],
        "dt": raw["dt"],
        "samples": raw["samples"],
    }
    return dataset(variables, coords, facts)
