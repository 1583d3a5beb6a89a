"""How far a long call is: a callback, or a bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Union

from .errors import DTypeError, InputError

#: ``callback(done, total)``, or ``True`` for a bar of tqdm's.
Progress = Union[Callable[[int, int], object], bool, None]


@contextmanager
def reporting(progress: Progress, unit: str) -> Iterator[Callable[[int, int], object] | None]:
    """The callback that ``progress`` means, for the time of a call."""
    if progress is None or progress is False:
        yield None
    elif progress is True:
        try:
            from tqdm.auto import tqdm  # type: ignore[import-untyped]
        except ImportError:
            raise InputError(
                "progress=True needs tqdm: install pymmae[progress], or pass a callback", "progress"
            ) from None
        with tqdm(unit=unit) as bar:

            def show(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            yield show
    elif callable(progress):
        yield progress
    else:
        raise DTypeError("progress: give a function of (done, total), or True", "dtype")
