"""Figures of results with matplotlib, the ones that the command line draws.

Needs ``pymmae[plot]``. Every function draws on ``ax`` (or axes of its own) and returns it.
Colours follow Okabe and Ito (2008).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from .errors import InputError

#: Colours of the models, in turn.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_NOT_GRID = {"model", "delay", "at_model", "boundary_number", "interval_number", "undecidable"}


def _axes(ax: Any, rows: int = 1, **options: Any) -> Any:
    if ax is not None:
        return ax
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise InputError("figures need matplotlib: install pymmae[plot]", "plot") from None
    _, made = plt.subplots(rows, 1, layout="constrained", **options)
    return made


def _colour(model: int) -> str:
    return COLOURS[model % len(COLOURS)]


def _named(array: xr.DataArray) -> str:
    units = array.attrs.get("units", "")
    return f"{array.name} ({units})" if units else str(array.name)


def _grid(sets: xr.Dataset) -> list[str]:
    dims = [str(d) for d in sets.winner.dims if d not in _NOT_GRID]
    if not 1 <= len(dims) <= 2:
        raise InputError(f"a figure has one or two parameters, not {len(dims)}: select", "shape")
    return dims


def eip(sets: xr.Dataset, ax: Any = None) -> Any:
    """Upsilon of every model along the grid, thick where it wins, the sets as bands; with
    two parameters the map of winners.

    With several delays the first is drawn; select another with ``sets.sel(delay=..)``.
    """
    if "delay" in sets.dims:
        sets = sets.isel(delay=0)
    dims = _grid(sets)
    ax = _axes(ax)
    labels = [str(label) for label in sets.label.values]
    if len(dims) == 2:
        return _map(sets, dims, labels, ax)
    x = sets[dims[0]].values
    winner = sets.winner.values
    best = np.nanmin(np.where(np.isfinite(sets.upsilon), sets.upsilon, np.nan), axis=-1)
    for i, label in enumerate(labels):
        upsilon = sets.upsilon.values[:, i]
        ax.plot(x, upsilon, color=_colour(i), lw=1, label=f"{i + 1}: {label}")
        ax.plot(x, np.where(winner == i, upsilon, np.nan), color=_colour(i), lw=3)
    bands = zip(sets.interval_model.values, sets.interval_from.values, sets.interval_to.values)
    for model, first, last in bands:
        ax.axvspan(first, last, color=_colour(int(model)), alpha=0.12, lw=0)
    for value in sets.boundary.values:
        ax.axvline(value, color="0.4", lw=0.8, ls="--")
    # curves far above the winners would flatten them
    top, low = np.nanmax(best), np.nanmin(best)
    ax.set_ylim(low - 0.1 * (top - low), top + 1.5 * (top - low))
    ax.set_xlim(x[0], x[-1])
    ax.set_xlabel(_named(sets[dims[0]]))
    ax.set_ylabel(f"Upsilon ({sets.upsilon.attrs['units']})")
    ax.set_title(sets.attrs.get("title", "Equivalently identified plants"))
    ax.legend(fontsize="small", frameon=False)
    return ax


def _map(sets: xr.Dataset, dims: list[str], labels: list[str], ax: Any) -> Any:
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    winner = np.ma.masked_less(sets.winner.transpose(*dims[::-1]).values, 0)
    colours = ListedColormap([_colour(i) for i in range(len(labels))])
    norm = BoundaryNorm(np.arange(len(labels) + 1) - 0.5, len(labels))
    x, y = sets[dims[0]], sets[dims[1]]
    ax.pcolormesh(x.values, y.values, winner, cmap=colours, norm=norm, shading="nearest")
    key = [Patch(color=_colour(i), label=f"{i + 1}: {label}") for i, label in enumerate(labels)]
    ax.legend(handles=key, fontsize="small")
    ax.set_xlabel(_named(x))
    ax.set_ylabel(_named(y))
    ax.set_title(sets.attrs.get("title", "Equivalently identified plants"))
    return ax


def _one_course(course: xr.Dataset) -> xr.Dataset:
    for dim in ("trial", "record"):
        if dim in course.dims:
            course = course.isel({dim: 0})
    return course


def weights(course: xr.Dataset, ax: Any = None) -> Any:
    """Weights of the models along time: of one record or the first trial, or of many
    trials their medians with bands that hold 50 % and 90 % of them."""
    course = _one_course(course)
    ax = _axes(ax)
    time = course.time.values
    for i, label in enumerate(course.label.values):
        if "p_quantiles" in course:
            low, quarter, middle, three, high = course.p_quantiles.values[:, i].T
            ax.fill_between(time, low, high, color=_colour(i), alpha=0.12, lw=0)
            ax.fill_between(time, quarter, three, color=_colour(i), alpha=0.25, lw=0)
        else:
            middle = course.p.values[:, i]
        ax.plot(time, middle, color=_colour(i), label=f"{i + 1}: {label}")
    ax.set_ylim(-0.02, 1.02)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("weight")
    ax.set_title(course.attrs.get("title", "Weights of the models"))
    ax.legend(fontsize="small", frameon=False)
    return ax


def errors(summary: xr.Dataset, ax: Any = None) -> Any:
    """Norm of the error of the fused state over many trials: median, bands of 50 % and
    90 %, root mean square."""
    ax = _axes(ax)
    time = summary.time.values
    low, quarter, middle, three, high = summary.x_error_norm_quantiles.values.T
    ax.fill_between(time, low, high, color=_colour(0), alpha=0.12, lw=0, label="90 % of the trials")
    ax.fill_between(time, quarter, three, color=_colour(0), alpha=0.25, lw=0, label="50 %")
    ax.plot(time, middle, color=_colour(0), label="median")
    ax.plot(time, summary.x_error_rms.values, color="0.5", label="root mean square")
    ax.set_xlabel("time (s)")
    ax.set_ylabel("norm of the error")
    ax.set_title(summary.attrs.get("title", "Errors of the fused state"))
    ax.legend(fontsize="small", frameon=False)
    return ax


def states(course: xr.Dataset, axes: Any = None) -> Any:
    """States along time: estimates, and those of the plant where they are known; of an
    adaptive observer with bands as :func:`parameters`, and outputs that were measured."""
    if "x_std" in course:
        return _states_of_observer(course, axes)
    course = _one_course(course)
    names = [str(name) for name in course.state.values]
    axes = _panels(axes, len(names))
    for j, (name, ax) in enumerate(zip(names, axes)):
        if "x" in course:
            ax.plot(course.time, course.x.values[:, j], color="0.6", lw=2, label="plant")
        ax.plot(course.time, course.x_hat.values[:, j], color=_colour(0), label="estimate")
        unit = str(course.state_units.values[j])
        ax.set_ylabel(f"{name} ({unit})" if unit else name)
    axes[0].legend(fontsize="small", frameon=False)
    axes[-1].set_xlabel("time (s)")
    return axes


def _panels(axes: Any, count: int) -> Any:
    """One axes a row, with a common time."""
    size = (7.0, max(4.0, 1.0 + 1.6 * count))
    return np.ravel(_axes(axes, count, sharex=True, squeeze=False, figsize=size))


def parameters(course: xr.Dataset, axes: Any = None) -> Any:
    """Parameters of an adaptive observer along time, over their true values in grey where
    they are known: the estimate with a band of two standard deviations, or of several trials
    their mean with bands that hold 50 % and 90 % of them.

    Of several cases, items or records the first is drawn; select another with ``sel``.
    """
    course = _one_observer(course)
    names = [str(name) for name in course.parameter.values]
    axes = _panels(axes, len(names))
    for i, (name, ax) in enumerate(zip(names, axes)):
        own = course.isel(parameter=i)
        truth = np.full(course.sizes["time"], float(own.theta)) if "theta" in course else None
        _estimate(ax, course.time.values, own.theta_hat, own.theta_std, truth)
        unit = str(own.parameter_units.values)
        ax.set_ylabel(f"{name} ({unit})" if unit else name)
    _finish(axes, course)
    return axes


def _states_of_observer(course: xr.Dataset, axes: Any) -> Any:
    course = _one_observer(course)
    names = [str(name) for name in course.state.values]
    axes = _panels(axes, len(names))
    plant = "plant_state" if "plant_state" in course.dims else "state"
    for name, ax in zip(names, axes):
        own = course.sel(state=name)
        known = "x" in course and name in course[plant].values
        truth = course.x.sel({plant: name}).values if known else None
        _estimate(ax, course.time.values, own.x_hat, own.x_std, truth)
        if "x" not in course and name in course.output.values:
            measured = course.y.sel(output=name).values
            ax.plot(course.time, measured, ".", color="0.3", ms=2, label="measured", zorder=1)
        unit = str(own.state_units.values)
        ax.set_ylabel(f"{name} ({unit})" if unit else name)
    _finish(axes, course)
    return axes


def _one_observer(course: xr.Dataset) -> xr.Dataset:
    """The first case, item and record; a single trial without its dimension."""
    for dim in ("case", "item", "record"):
        if dim in course.dims:
            course = course.isel({dim: 0})
    if course.sizes.get("trial") == 1:
        course = course.isel(trial=0)
    return course


def _estimate(ax: Any, time: Any, hat: xr.DataArray, std: xr.DataArray, truth: Any) -> None:
    """An estimate with its band."""
    if "trial" in hat.dims:
        # trials that ran away are left out
        middle = hat.mean("trial").values
        edges = hat.quantile([0.05, 0.25, 0.75, 0.95], "trial").values
        bands = [(edges[0], edges[3], "90 % of the trials"), (edges[1], edges[2], "50 %")]
        label = "mean"
    else:
        middle, spread = hat.values, 2 * std.values
        bands = [(middle - spread, middle + spread, "two standard deviations")]
        label = "estimate"
    # at the start a band is as wide as the prior: it would flatten the curve
    shown = np.concatenate([middle, [] if truth is None else truth])
    shown = shown[np.isfinite(shown)]
    if shown.size:
        low, high = shown.min(), shown.max()
        room = 0.6 * max(high - low, 1e-12 * abs(high), 1e-300)
        bands = [(a.clip(low - room, high + room), b.clip(low - room, high + room), text)
                 for a, b, text in bands]  # fmt: skip
    for (lower, upper, text), alpha in zip(bands, (0.12, 0.25)):
        ax.fill_between(time, lower, upper, color=_colour(0), alpha=alpha, lw=0, label=text)
    if truth is not None:
        ax.plot(time, truth, color="0.6", lw=2, label="plant")
    ax.plot(time, middle, color=_colour(0), label=label)


def _finish(axes: Any, course: xr.Dataset) -> None:
    axes[0].set_title(course.attrs.get("title") or "Adaptive observer")
    axes[-1].set_xlabel("time (s)")
    # below the name of the axis, where it hides nothing
    handles = {text: handle for ax in axes for handle, text in zip(*ax.get_legend_handles_labels())}
    key = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.0}
    axes[-1].legend(
        list(handles.values()), list(handles), ncols=4, fontsize="small", frameon=False, **key
    )
