"""What a call costs: overhead, copies, threads, and sweeps beside SciPy and joblib.

    python python/benches/calls.py [--quick] [--json FILE]

Needs pymmae with its extras, SciPy and joblib. Prints a table in Markdown; ``--json`` writes
every timing behind it. A number is the best of several rounds, and results are compared
before they are timed. Sizes are for a machine of two cores.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pymmae
import scipy
import scipy.linalg as sl
from pymmae import _core

EYE = np.eye(2)


class Table:
    """Rows that are printed, and what they were computed from."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def add(self, what: str, value: float, unit: str, note: str = "", **raw: Any) -> None:
        self.rows.append({"what": what, "value": value, "unit": unit, "note": note, **raw})

    def markdown(self) -> str:
        lines = ["| what | | unit | |", "|---|--:|---|---|"]
        for row in self.rows:
            lines.append(f"| {row['what']} | {row['value']:.4g} | {row['unit']} | {row['note']} |")
        return "\n".join(lines)


def rounds(call: Callable[[], object], repeat: int, count: int = 5) -> list[float]:
    """Seconds of a call, one number a round of ``repeat`` calls."""
    times = []
    for _ in range(count):
        start = time.perf_counter()
        for _ in range(repeat):
            call()
        times.append((time.perf_counter() - start) / repeat)
    return times


def overhead(table: Table, quick: bool) -> None:
    """A call with one equation of order 2, beside what the engine needs for one of many."""
    repeat = 200 if quick else 5000
    many = np.tile(-EYE, (4096, 1, 1))
    for name, call in [
        ("`lyap`, one equation of order 2", lambda: pymmae.lyap(-EYE, EYE, threads=1)),
        ("`care`, one equation of order 2", lambda: pymmae.care(-EYE, EYE, EYE, EYE, threads=1)),
        ("conversion of one argument", lambda: _core._where(EYE)),
    ]:
        times = rounds(call, repeat)
        table.add(name, 1e6 * min(times), "us a call", seconds=times, calls=repeat)
    times = rounds(lambda: pymmae.lyap(many, EYE, threads=1), 3)
    table.add("`lyap`, each of 4096", 1e6 * min(times) / len(many), "us an equation", seconds=times)


def copies(table: Table, quick: bool) -> None:
    """An argument that nobody can write to is used in place; others are copied once."""
    size = 1 << (16 if quick else 22)
    a = np.zeros((size // 4, 2, 2))
    frozen = a.copy()
    frozen.flags.writeable = False
    address = frozen.__array_interface__["data"][0]
    assert _core._where(frozen) == (address, True)
    assert _core._where(a)[1] is False
    for name, array, note in [
        ("writable", a, "copied once"),
        ("frozen", frozen, "the engine reads it at its own address"),
    ]:
        times = rounds(lambda array=array: _core._where(array), 5)
        what = f"argument of {array.nbytes / (1 << 20):.3g} MiB, {name}"
        table.add(what, 1e6 * min(times), "us", note, seconds=times)
    # results: the memory is still that of the engine's own vector
    X = pymmae.lyap(np.tile(-EYE, (100, 1, 1)), EYE).X
    while isinstance(X, np.ndarray):
        assert not X.flags.owndata
        X = X.base
    assert X is not None


def threads(table: Table, quick: bool) -> None:
    """Python threads beside one, each call on one thread of the engine."""
    rng = np.random.default_rng(1)
    count = 200 if quick else 20_000
    a = rng.standard_normal((count, 6, 6))
    six = np.eye(6)

    def work() -> None:
        pymmae.care(a, six, six, six, threads=1)

    def spread(n: int) -> None:
        all_ = [threading.Thread(target=work) for _ in range(n)]
        for t in all_:
            t.start()
        for t in all_:
            t.join()

    # in turns, so that both see the same machine
    one, four = [], []
    for _ in range(5):
        one += rounds(lambda: spread(1), 1, 1)
        four += rounds(lambda: spread(4), 1, 1)
    what = f"4 Python threads, {count} CAREs of order 6 each"
    table.add(what, 4 * min(one) / min(four), "times one thread", one=one, four=four)


def equations(table: Table, quick: bool) -> None:
    """Stacked equations: one call, SciPy in a loop, joblib's processes."""
    rng = np.random.default_rng(2)
    count, n = (64 if quick else 4000), 6
    a, b = rng.standard_normal((count, n, n)), rng.standard_normal((count, n, 2))
    q, r = np.eye(n), np.eye(2)
    want = np.array([sl.solve_continuous_are(a[k], b[k], q, r) for k in range(count)])
    got = pymmae.care(a, b, q, r).X
    assert np.abs(got - want).max() <= 1e-6 * np.abs(want).max()

    def some(part: Any) -> None:
        for k in part:
            sl.solve_continuous_are(a[k], b[k], q, r)

    beside(table, f"{count} CAREs of order {n}", count, lambda: pymmae.care(a, b, q, r), some)


def sweep(table: Table, quick: bool) -> None:
    """A study of an oscillator over its stiffness beside the textbook's: a Riccati equation a
    model, a Lyapunov equation of the joint order for each plant and model."""
    count = 41 if quick else 2001
    grid = np.linspace(0.5, 2.0, count)
    nominal = [0.6, 1.0, 1.7]

    def plant(k: float) -> np.ndarray:
        return np.array([[0.0, 1.0], [-k, -0.3]])

    G, C, R = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.array([[0.01]])
    scenario = pymmae.Scenario({
        "plant": {"time": "continuous", "states": ["x", "v"], "outputs": ["x"],
                  "disturbances": ["w"], "A": [[0, 1], ["-k", -0.3]], "G": [0, 1], "C": [1, 0],
                  "Q": 1, "R": 0.01, "parameters": {"k": 1.0}},
        "bank": {"models": {"k": nominal}},
        "eip": {"grid": {"k": grid}, "verify": "none"},
    })  # fmt: skip
    gains = []
    for k in nominal:
        P = sl.solve_continuous_are(plant(k).T, C.T, G @ G.T, R)
        gains.append(P @ C.T / R)

    def upsilon(j: int) -> list[float]:
        A, out = plant(grid[j]), []
        for k, H in zip(nominal, gains):
            joint = np.block([[A, np.zeros((2, 2))], [H @ C, plant(k) - H @ C]])
            noise = np.block([[G @ G.T, np.zeros((2, 2))], [np.zeros((2, 2)), H @ R @ H.T]])
            D = np.hstack([C, -C])
            X = sl.solve_continuous_lyapunov(joint, -noise)
            out.append(0.5 * (D @ X @ D.T / R).item())
        return out

    want = np.array([upsilon(j) for j in range(count)])
    got = pymmae.eip(scenario).upsilon.values
    assert np.abs(got - want).max() <= 1e-9 * np.abs(want).max()

    def some(part: Any) -> None:
        for j in part:
            upsilon(j)

    what = f"sets of {count} plants and {len(nominal)} models"
    beside(table, what, count, lambda: pymmae.eip(scenario), some)


def beside(
    table: Table, what: str, count: int, ours: Callable[[], object], some: Callable[[Any], None]
) -> None:
    """One call, a loop over ``count`` items, the loop in two processes."""
    mine = rounds(ours, 1)
    table.add(f"{what}: pymmae", count / min(mine), "a second", seconds=mine)
    scipy_times = rounds(lambda: some(range(count)), 1, 2)
    longer = f"{min(scipy_times) / min(mine):.3g} times longer"
    rate = count / min(scipy_times)
    table.add(f"{what}: SciPy in a loop", rate, "a second", longer, seconds=scipy_times)
    try:
        from joblib import Parallel, delayed
    except ImportError:
        return
    parts = np.array_split(np.arange(count), 8)
    with Parallel(n_jobs=2) as pool:
        pool(delayed(some)(part) for part in parts)  # the processes are started
        times = rounds(lambda: pool(delayed(some)(part) for part in parts), 1, 2)
    longer = f"{min(times) / min(mine):.3g} times longer"
    table.add(f"{what}: joblib, 2 processes", count / min(times), "a second", longer, seconds=times)


def shards(table: Table, quick: bool) -> None:
    """A study in 1,000 short shards beside the same in one: what a shard adds, and how much
    that is of a shard of a second. The tasks run in this process, on one thread."""
    points = 2001 if quick else 2_000_001
    count = 20 if quick else 1000
    study = {
        "plant": {"family": "pendulum"},
        "bank": {"models": {"L": [1.025, 1.287, 1.526, 1.778]}},
        "eip": {"grid": {"L": {"from": 0.9, "to": 1.9, "points": points}}, "verify": "none"},
    }
    with tempfile.TemporaryDirectory() as folder:
        block = points // count + 1
        took, digests = [], set()
        for n in (1, count):
            start = time.perf_counter()
            done = pymmae.sweep(study, Path(folder) / str(n), block=block, shards=n, threads=1)
            took.append(time.perf_counter() - start)
            digests.add(done.sha256)
    assert len(digests) == 1
    more = (took[1] - took[0]) / count
    what = f"a sweep of {count} shards of {took[0] / count:.3g} s, beside one process"
    table.add(what, 1e3 * more, "ms more a shard", seconds=took, points=points)
    note = "from the line above, not from shards of a second"
    table.add("the same, of shards of one second", 100 * more, "% longer", note)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small sizes, as a test")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the timings")
    arguments = parser.parse_args()
    machine = {
        "pymmae": pymmae.VERSION,
        "cpu_tier": pymmae.CPU_TIER,
        "cpus": os.cpu_count(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "quick": arguments.quick,
    }
    table = Table()
    for part in (overhead, copies, threads, equations, sweep, shards):
        part(table, arguments.quick)
    print(", ".join(f"{name} {value}" for name, value in machine.items()), end="\n\n")
    print(table.markdown())
    if arguments.json:
        arguments.json.write_text(json.dumps({"machine": machine, "rows": table.rows}, indent=1))


if __name__ == "__main__":
    main()
