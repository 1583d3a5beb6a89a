"""What becomes an array of float64, and what is refused by name."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DTypeError, InputError, LimitError


def _memory() -> int:
    """Bytes of the machine's memory, a terabyte where it does not say."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return 1 << 40


MEMORY = _memory()


def room(what: str, size: int) -> None:
    """Raises ``LimitError`` if ``size`` bytes are more than the machine has."""
    if size > MEMORY:
        raise LimitError(
            f"{what} needs {size} bytes, over the machine's {MEMORY}: work in parts", "limit"
        )


def convert(name: str, value: Any) -> NDArray[np.float64]:
    """``value`` as a new array of float64 in C order.

    Integers and floats of up to 64 bits are promoted (integers beyond 2**53 are rounded).
    Nothing else is taken for a number: no complex, Boolean, object, text, date or
    extended-precision values, no foreign byte order, no masked arrays.
    """
    if isinstance(value, np.ma.MaskedArray):
        raise DTypeError(f"{name} is a masked array: fill it, or select what is valid", "dtype")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is no array of numbers ({error}): give one", "dtype") from None
    dtype = array.dtype
    if not dtype.isnative:
        raise DTypeError(
            f"{name} has the byte order of another machine ({dtype.str}): convert it with "
            ".astype(float)",
            "dtype",
        )
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise DTypeError(f"{name} holds {dtype}: give float64, float32 or integers", "dtype")
    if array.size == 0:
        raise InputError(f"{name} is empty: give at least one", "empty")
    room(name, array.size * 8)
    return np.array(array, dtype=np.float64, order="C", copy=True, subok=False)
