"""Arrays of the engine as labelled datasets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core

if TYPE_CHECKING:
    import xarray as xr

Variables = dict[str, tuple[Any, ...]]

#: Names that a dataset of any kind uses itself.
_TAKEN = {"model", "state", "time", "trial", "output", "input", "parameter", "quantile", "delay"}


def texts(values: Sequence[str]) -> np.ndarray[Any, np.dtype[np.str_]]:
    """Texts as an array that every file format takes."""
    return np.array(list(values), dtype=f"U{max([1, *map(len, values)])}")


def attrs(units: str, long_name: str, **more: Any) -> dict[str, Any]:
    """Attributes of a variable."""
    return {"units": units, "long_name": long_name, **more}


def own_names(names: Sequence[str], taken: set[str]) -> list[str]:
    """Parameter names as dimensions, with ``plant_`` in front where a name is taken."""
    return [f"plant_{n}" if n in taken | _TAKEN else n for n in names]


def models(raw: Mapping[str, Any], units: Mapping[str, str]) -> Variables:
    """Coordinates of the dimension ``model``."""
    count = len(raw["labels"])
    coords: Variables = {
        "model": ("model", np.arange(count), attrs("1", "index of the model")),
        "label": ("model", texts(raw["labels"]), {"long_name": "label of the model"}),
    }
    if raw["values"].shape[1] > 0:
        coords["parameter"] = ("parameter", texts(raw["parameters"]))
        coords["nominal"] = (
            ("model", "parameter"),
            raw["values"],
            attrs("units of the parameter", "value of the parameter in the model"),
        )
        coords["parameter_units"] = ("parameter", unit_list(raw["parameters"], units))
    return coords


def unit_list(names: Sequence[str], units: Mapping[str, str]) -> np.ndarray[Any, np.dtype[np.str_]]:
    """Units by name, empty where none was given."""
    return texts([units.get(name, "") for name in names])


def channels(dim: str, names: Sequence[str], count: int, units: Mapping[str, str]) -> Variables:
    """Coordinates of states, inputs or outputs, by number where they have no names."""
    full = [*names][:count]
    full += [f"{dim}{i + 1}" for i in range(len(full), count)]
    return {dim: (dim, texts(full)), f"{dim}_units": (dim, unit_list(full, units))}


def dataset(variables: Variables, coords: Variables, facts: Mapping[str, Any]) -> xr.Dataset:
    """The dataset with the version of the engine among its attributes."""
    # here and nowhere else: it takes most of the time that importing the package would,
    # and workers of a sweep do without
    import xarray as xr

    known = {key: value for key, value in facts.items() if value is not None}
    return xr.Dataset(variables, coords, {**known, "version": _core.VERSION})
