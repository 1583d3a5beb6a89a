"""The extension module; use the functions of the package instead."""

from collections.abc import Callable, Mapping
from typing import Any

VERSION: str
CPU_TIER: str

_Tell = Callable[[int, int], object] | None

class Scenario:
    def __new__(cls, name: str, text: str, family: Mapping[str, Any] | None = None) -> Scenario: ...
    def about(self) -> dict[str, Any]: ...
    def plant(self, values: list[tuple[str, float]]) -> dict[str, Any]: ...

def care(
    a: Any,
    b: Any,
    q: Any,
    r: Any,
    s: Any,
    discrete: bool,
    check: str,
    threads: int | None,
) -> dict[str, Any]: ...
def lyapunov(a: Any, q: Any, discrete: bool, check: str, threads: int | None) -> dict[str, Any]: ...
def sylvester(
    a: Any, b: Any, c: Any, discrete: bool, check: str, threads: int | None
) -> dict[str, Any]: ...
def riccati_ode(
    f: Any, h: Any, q: Any, r: Any, p: Any, step: Any, threads: int | None
) -> dict[str, Any]: ...
def eip(scenario: Scenario, threads: int | None, progress: _Tell) -> dict[str, Any]: ...
def place(
    scenario: Scenario,
    cells: int | None,
    edges: list[float] | None,
    excess: float | None,
    anchor: float | None,
    threads: int | None,
) -> dict[str, Any]: ...
def estimate(scenario: Scenario, y: Any, u: Any, t: Any, progress: _Tell) -> dict[str, Any]: ...
def estimate_many(
    scenario: Scenario, y: Any, u: Any, t: Any, every: int, threads: int | None, progress: _Tell
) -> dict[str, Any]: ...
def adaptive_trials(
    scenario: Scenario,
    observer: str | None,
    grid: Mapping[str, Any],
    case: str | None,
    truth: list[tuple[str, float]],
    trials: int | None,
    seed: int | None,
    every: int | None,
    tolerance: float,
    threads: int | None,
    progress: _Tell,
) -> dict[str, Any]: ...
def adaptive_records(
    scenario: Scenario,
    observer: str | None,
    grid: Mapping[str, Any],
    y: Any,
    u: Any,
    t: Any,
    every: int,
    tolerance: float,
    threads: int | None,
    progress: _Tell,
) -> dict[str, Any]: ...
def trials(
    scenario: Scenario,
    truth: list[tuple[str, float]],
    trials: int | None,
    seed: int | None,
    every: int | None,
    keep: int,
    threads: int | None,
    progress: _Tell,
) -> dict[str, Any]: ...
def blocks(scenario: Scenario, salt: bytes, block: int | None, refine: bool) -> int: ...
def complete(
    scenario: Scenario, salt: bytes, block: int | None, refine: bool, dir: str
) -> str | None: ...
def shard(
    scenario: Scenario,
    salt: bytes,
    block: int | None,
    refine: bool,
    index: int,
    of: int,
    dir: str,
    threads: int | None,
) -> dict[str, Any]: ...
def merge(dirs: list[str], out: str, force: bool) -> str: ...
def _where(value: Any) -> tuple[int, bool]: ...
def _panic(apart: bool) -> None: ...
def _wait(seconds: float, progress: _Tell = None) -> None: ...
