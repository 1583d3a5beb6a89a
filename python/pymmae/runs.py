"""Banks that run: on recorded data, and on simulated trials."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._label import Variables, attrs, channels, dataset, models, texts
from ._progress import Progress, reporting
from .errors import InputError
from .scenario import Scenario, ScenarioLike, scenario_of

if TYPE_CHECKING:
    import xarray as xr

_ONE = "1"
_STATE, _OUTPUT, _INPUT = (f"units of the {what}" for what in ("state", "output", "input"))


def estimate(
    scenario: ScenarioLike,
    y: ArrayLike,
    u: ArrayLike | None = None,
    *,
    t: ArrayLike | None = None,
    every: int | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> xr.Dataset:
    """The bank of a scenario on recorded data.

    .. code-block:: text

        predict    x_i <- A_i x_i + B_i u,          P_i <- A_i P_i A_i' + G_i Q_i G_i'
        innovate   r_i = y - C_i x_i,               S_i = C_i P_i C_i' + R_i
        weigh      ln p_i += ln N(r_i; 0, S_i),     or the law of [weighting]
        fuse       x_hat = sum p_i x_i

    ``y`` has shape ``(time, output)``, NaN for what is missing, one row each ``dt``
    seconds; ``u`` ``(time, input)``, the inputs that act from the time of their row on.
    ``t``, shape ``(time,)``, are the times of the rows in seconds where they are uneven, as a
    column ``t`` of ``mmae estimate``: a gap of whole multiples of ``dt`` is measurements that
    are missing; at any other times the plant is sampled anew for each interval, which
    Kalman filters of continuous plants with a covariance recursion allow
    (``observer = "kalman"`` with ``P0``). All records share ``t``.
    One record gives all of it: ``p``, ``log_p``, ``x_hat``, ``theta_hat``, ``nis``, the
    innovations ``r``, ``log_lik``. With a dimension ``record`` in front many records run
    at once, eight in lanes, and every ``every``-th step is reported (0: the end alone, the
    default): ``log_p``, ``p``, ``x_hat``, ``theta_hat``, ``log_lik``. A record is the
    same by bits in any company and for any number of threads.

    Source: Lainiotis (1976), Proc. IEEE 64; Aguiar et al. (2007), eqs. (8)-(12) in
    continuous time.

    Raises ``InputError`` for arrays that do not fit and for times that do not rise or that
    the observers cannot take, ``NumericalError`` once every model has failed.

    >>> import numpy as np, pymmae
    >>> bank = pymmae.Scenario({
    ...     "plant": {"time": "discrete", "dt": 1.0, "states": ["level"],
    ...               "outputs": ["level"], "disturbances": ["w"], "A": 1, "G": 1, "C": 1,
    ...               "Q": 0.01, "R": "r", "parameters": {"r": 1.0}},
    ...     "bank": {"models": {"r": [0.1, 10.0]}}})
    >>> y = np.sin(0.7 * np.arange(20.0) ** 2)[:, None]
    >>> course = pymmae.estimate(bank, y)
    >>> bool(abs(course.p.sum("model") - 1).max() < 1e-12)
    True
    """
    taken = scenario_of(scenario)
    units = taken.units
    if np.ndim(y) == 3:
        with reporting(progress, "record") as tell:
            raw = _core.estimate_many(taken._core, y, u, t, every or 0, threads, tell)
        return _many(raw, units)
    if every:
        raise InputError("every: one record is reported at every step; select from it", "conflict")
    with reporting(progress, "sample") as tell:
        raw = _core.estimate(taken._core, y, u, t, tell)
    time, by_model = ("time",), ("time", "model")
    variables: Variables = {
        "p": (by_model, raw["p"], attrs(_ONE, "weight of the model")),
        "log_p": (by_model, raw["log_p"], attrs(_ONE, "logarithm of the weight")),
        "x_hat": (("time", "state"), raw["x_hat"], attrs(_STATE, "fused estimate")),
        "nis": (by_model, raw["nis"], attrs(_ONE, "normalised innovation squared")),
        "r": (("time", "model", "output"), raw["r"], attrs(_OUTPUT, "innovation")),
        "log_lik": (time, raw["log_lik"], attrs(_ONE, "log-likelihood of the measurement")),
        "log_lik_models": ("model", raw["log_lik_models"], attrs(_ONE, "of the whole record")),
        "failed": ("model", raw["failed"], attrs(_ONE, "the member ran away")),
    }
    _theta_hat(variables, raw, time)
    coords = models(raw, units)
    coords |= channels("state", raw["states"], raw["x_hat"].shape[1], units)
    coords |= channels("output", raw["outputs"], raw["r"].shape[2], units)
    coords["time"] = ("time", raw["t"], attrs("s", "time"))
    facts = {"title": taken.title, "law": raw["law"], "nis_band": list(raw["nis_band"])}
    return dataset(variables, coords, facts)


def _theta_hat(variables: Variables, raw: dict[str, Any], lead: tuple[str, ...]) -> None:
    """``theta_hat = sum p_i theta_i``, where the models differ in parameters."""
    if raw["values"].shape[1] > 0:
        p = np.asarray(variables["p"][1])
        # a model without weight may stand anywhere
        data = np.where(p > 0, p, 0.0) @ raw["values"]
        long = "mean of the parameter over the weights"
        variables["theta_hat"] = ((*lead, "parameter"), data, attrs("units of the parameter", long))


def _many(raw: dict[str, Any], units: Mapping[str, str]) -> xr.Dataset:
    lead = ("record", "time")
    variables: Variables = {
        "p": ((*lead, "model"), np.exp(raw["log_p"]), attrs(_ONE, "weight of the model")),
        "log_p": ((*lead, "model"), raw["log_p"], attrs(_ONE, "logarithm of the weight")),
        "x_hat": ((*lead, "state"), raw["x_hat"], attrs(_STATE, "fused estimate")),
        "log_lik": ("record", raw["log_lik"], attrs(_ONE, "log-likelihood of the record")),
        "log_lik_models": (
            ("record", "model"),
            raw["log_lik_models"],
            attrs(_ONE, "log-likelihood of the record under each model"),
        ),
        "failed": (("record", "model"), raw["failed"], attrs(_ONE, "the member ran away")),
    }
    _theta_hat(variables, raw, lead)
    coords = models(raw, units)
    coords |= channels("state", raw["states"], raw["x_hat"].shape[2], units)
    coords["time"] = ("time", raw["t"], attrs("s", "time"))
    return dataset(variables, coords, {"law": raw["law"]})


def _trials(
    taken: Scenario,
    truth: Mapping[str, float] | None,
    trials: int | None,
    seed: int | None,
    every: int | None,
    keep: int,
    threads: int | None,
    progress: Progress,
) -> dict[str, Any]:
    changes = [(name, float(value)) for name, value in (truth or {}).items()]
    with reporting(progress, "trial") as tell:
        return _core.trials(taken._core, changes, trials, seed, every, keep, threads, tell)


def run(
    scenario: ScenarioLike,
    *,
    trials: int = 1,
    seed: int | None = None,
    every: int = 1,
    truth: Mapping[str, float] | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> xr.Dataset:
    """Simulated trials of a bank, step by step.

    .. code-block:: text

        x(k) = A x(k-1) + B u(k) + G w(k),   y(k) = C x(k) + v(k)      the plant of [truth]
        predict, innovate, weigh, fuse                                 the bank

    Dimensions ``trial``, ``time``, and ``state``, ``output``, ``input``, ``model``;
    variables ``x`` of the plant, ``x_hat``, ``y``, ``u``, ``log_p``, ``p``, ``theta_hat``
    and the true ``theta``. ``every`` so many steps a report; ``truth`` replaces parameters
    of the plant by name, ``seed`` that of the scenario. Trial i has the same random numbers
    whatever the number of trials and threads. For statistics over many see
    :func:`monte_carlo`.

    Source: Zhang, Wang, Zhang (2018), section 5, for the tracker; the simulation is exact.

    Raises ``ScenarioError`` without ``[run]``, ``LimitError`` for courses that do not fit
    in memory.

    >>> import pymmae
    >>> course = pymmae.run({"plant": {"family": "tracker"},
    ...     "bank": {"models": {"rho": [0.96, 0.97, 1.0, 1.01]}, "x0": [-100, 2, 200, 20],
    ...              "P0": 0},
    ...     "truth": {"model": 3}, "run": {"steps": 30}}, trials=2)
    >>> dict(course.x_hat.sizes)
    {'trial': 2, 'time': 30, 'state': 4}
    >>> bool((course.p.sum("model") - 1).max() < 1e-12)
    True
    """
    if every < 1:
        raise InputError(f"every = {every} is out of range: give at least one step", "range")
    taken = scenario_of(scenario)
    raw = _trials(taken, truth, trials, seed, every, trials, threads, progress)
    lead = ("trial", "time")
    common = raw["course_x"].shape[2] == raw["course_x_hat"].shape[2]
    states = "state" if common else "plant_state"
    variables: Variables = {
        "x": ((*lead, states), raw["course_x"], attrs(_STATE, "state of the plant")),
        "x_hat": ((*lead, "state"), raw["course_x_hat"], attrs(_STATE, "fused estimate")),
        "y": ((*lead, "output"), raw["course_y"], attrs(_OUTPUT, "measurement")),
        "log_p": ((*lead, "model"), raw["course_log_p"], attrs(_ONE, "logarithm of the weight")),
        "p": ((*lead, "model"), np.exp(raw["course_log_p"]), attrs(_ONE, "weight of the model")),
    }
    units = taken.units
    coords = models(raw, units)
    if raw["course_u"].shape[2] > 0:
        variables["u"] = ((*lead, "input"), raw["course_u"], attrs(_INPUT, "command"))
        coords |= channels("input", raw["inputs"], raw["course_u"].shape[2], units)
    if raw["theta"].shape[1] > 0:
        long = "true value of the parameter"
        about = attrs("units of the parameter", long)
        variables["theta"] = (("time", "parameter"), raw["theta"], about)
    _theta_hat(variables, raw, lead)
    coords |= channels("state", raw["states"], raw["course_x_hat"].shape[2], units)
    if not common:
        coords |= channels("plant_state", taken.states, raw["course_x"].shape[2], units)
    coords |= channels("output", raw["outputs"], raw["course_y"].shape[2], units)
    coords["trial"] = ("trial", raw["trial"], attrs(_ONE, "number of the trial"))
    coords["time"] = ("time", raw["record"] * raw["dt"], attrs("s", "time"))
    return dataset(variables, coords, _facts(raw))


def _facts(raw: dict[str, Any]) -> dict[str, Any]:
    return {
        "title": raw["title"],
        "law": raw["law"],
        "trials": raw["trials"],
        "steps": raw["steps"],
        "seed": str(raw["seed"]),  # beyond the integers of some file formats
        "nis_band": list(raw["nis_band"]),
        "nees_band": list(raw["nees_band"]),
    }


_BY_MODEL = {
    "p": "mean weight of the model",
    "p_std": "standard deviation of the weight",
    "log_p": "mean logarithm of the weight",
    "identified": "fraction of trials in which the model has the largest weight",
    "nis": "mean normalised innovation squared",
    "nis_inside": "fraction of trials with it in its 95 % band",
    "nees": "mean normalised error squared",
    "nees_inside": "fraction of trials with it in its 95 % band",
    "failed": "fraction of trials in which the member failed",
}
_BY_STATE = {
    "x_error_mean": "mean error of the state",
    "x_error_std": "standard deviation of the error",
}
_ALONE = {
    "x_error_rms": (_STATE, "root of the mean square of the norm of the error"),
    "nees_fused": (_ONE, "normalised error squared of the fused estimate"),
    "nees_fused_inside": (_ONE, "fraction of trials with it in its 95 % band"),
}


def monte_carlo(
    scenario: ScenarioLike,
    *,
    trials: int | None = None,
    seed: int | None = None,
    every: int | None = None,
    truth: Mapping[str, float] | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> xr.Dataset:
    """Statistics over many simulated trials of a bank.

    .. code-block:: text

        p_i = mean p_i(trial),   x_error_rms = sqrt(mean |x - x_hat|^2)
        nis_i = mean r_i' S_i^-1 r_i,   nees_i = mean (x - x_i)' P_i^-1 (x - x_i)

    What ``mmae run`` reports, with the same meaning (guide, page "results"): dimensions
    ``time`` (every ``every``-th step and the end), ``model``, ``state``, ``parameter``,
    ``quantile``. ``trials``, ``seed`` and ``every`` are those of ``[run]`` unless stated;
    ``truth`` replaces parameters of the plant by name. Memory does not grow with the
    trials, and the numbers have the same bits for any number of threads.

    Source: Bar-Shalom, Li, Kirubarajan (2001), section 5.4, for the bands in the
    attributes ``nis_band`` and ``nees_band``.

    Raises as :func:`run`.

    >>> import pymmae
    >>> summary = pymmae.monte_carlo({"plant": {"family": "tracker"},
    ...     "bank": {"models": {"rho": [0.96, 0.97, 1.0, 1.01]}, "x0": [-100, 2, 200, 20],
    ...              "P0": 0},
    ...     "truth": {"model": 3}, "run": {"steps": 50, "trials": 40}})
    >>> bool(summary.identified.isel(time=-1, model=2) > 0.7)
    True
    """
    taken = scenario_of(scenario)
    raw = _trials(taken, truth, trials, seed, every, 0, threads, progress)
    variables: Variables = {}
    for name, long in _BY_MODEL.items():
        variables[name] = (("time", "model"), raw[name], attrs(_ONE, long))
    for name, long in _BY_STATE.items():
        variables[name] = (("time", "state"), raw[name], attrs(_STATE, long))
    for name, (unit, long) in _ALONE.items():
        variables[name] = ("time", raw[name], attrs(unit, long))
    spread = "quantiles over the trials"
    by_model = ("time", "model", "quantile")
    variables["p_quantiles"] = (by_model, raw["p_quantiles"], attrs(_ONE, spread))
    variables["x_error_quantiles"] = (
        ("time", "state", "quantile"),
        raw["x_error_quantiles"],
        attrs(_STATE, spread),
    )
    variables["x_error_norm_quantiles"] = (
        ("time", "quantile"),
        raw["x_error_norm_quantiles"],
        attrs(_STATE, spread),
    )
    unit = "units of the parameter"
    if raw["theta_hat_quantiles"].shape[1] > 0:
        variables["theta_hat_quantiles"] = (
            ("time", "parameter", "quantile"),
            raw["theta_hat_quantiles"],
            attrs(unit, spread),
        )
    _theta_hat(variables, raw, ("time",))
    if raw["theta"].shape[1] > 0:
        about = attrs(unit, "true value of the parameter")
        variables["theta"] = (("time", "parameter"), raw["theta"], about)
    failures = [""] * len(raw["labels"])
    for index, message in raw["failures"]:
        failures[index] = message
    variables["failure"] = ("model", texts(failures))
    units = taken.units
    coords = models(raw, units)
    coords |= channels("state", raw["states"], raw["x_error_mean"].shape[1], units)
    coords["quantile"] = ("quantile", raw["levels"], attrs(_ONE, "level of the quantile"))
    coords["time"] = ("time", raw["record"] * raw["dt"], attrs("s", "time"))
    return dataset(variables, coords, _facts(raw))
