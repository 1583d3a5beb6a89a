"""What a call costs: overhead, copies, threads, and sweeps beside SciPy and joblib.

    python python/benches/calls.py [--quick]

Needs pymmae with its extras, SciPy and joblib. Every number is the best of several rounds;
results are compared before they are timed. Sizes are for a machine of two cores.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymmae
import scipy.linalg as sl
from pymmae import _core

EYE = np.eye(2)


def best(call: Callable[[], object], repeat: int, rounds: int = 5) -> float:
    """Seconds of a call."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(repeat):
            call()
        times.append((time.perf_counter() - start) / repeat)
    return min(times)


def overhead(quick: bool) -> None:
    """A call with one equation of order 2, less what the engine needs for one of many."""
    repeat = 200 if quick else 5000
    many = np.tile(-EYE, (4096, 1, 1))
    each = best(lambda: pymmae.lyap(many, EYE, threads=1), 3) / len(many)
    for name, call in [
        ("lyap, one equation", lambda: pymmae.lyap(-EYE, EYE, threads=1)),
        ("care, one equation", lambda: pymmae.care(-EYE, EYE, EYE, EYE, threads=1)),
        ("conversion of one argument", lambda: _core._where(EYE)),
    ]:
        print(f"{name:32} {1e6 * best(call, repeat):8.1f} us a call")
    print(f"{'lyap, each of 4096':32} {1e6 * each:8.2f} us an equation")


def copies(quick: bool) -> None:
    """An argument that nobody can write to is used in place; others are copied once."""
    size = 1 << (16 if quick else 22)
    a = np.zeros((size // 4, 2, 2))
    frozen = a.copy()
    frozen.flags.writeable = False
    address = frozen.__array_interface__["data"][0]
    assert _core._where(frozen) == (address, True)
    assert _core._where(a)[1] is False
    for name, array in [("writable", a), ("frozen", frozen)]:
        took = best(lambda array=array: _core._where(array), 5)
        print(f"{f'{array.nbytes >> 20} MiB argument, {name}':32} {1e6 * took:8.1f} us")


def threads(quick: bool) -> None:
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

    one, four = best(lambda: spread(1), 1), best(lambda: spread(4), 1)
    print(f"{'4 Python threads':32} {4 * one / four:8.2f} times one")


def peers(quick: bool) -> None:
    """A sweep over stacked equations: one call, SciPy in a loop, joblib's processes."""
    rng = np.random.default_rng(2)
    count, n = (64 if quick else 4000), 6
    a, b = rng.standard_normal((count, n, n)), rng.standard_normal((count, n, 2))
    q, r = np.eye(n), np.eye(2)
    want = np.array([sl.solve_continuous_are(a[k], b[k], q, r) for k in range(count)])
    got = pymmae.care(a, b, q, r).X
    assert np.abs(got - want).max() <= 1e-6 * np.abs(want).max()

    def loop() -> None:
        for k in range(count):
            sl.solve_continuous_are(a[k], b[k], q, r)

    ours = best(lambda: pymmae.care(a, b, q, r), 1)
    scipy = best(loop, 1, 2)
    print(f"{f'{count} CAREs of order {n}, pymmae':32} {count / ours:8.0f} a second")
    print(f"{'SciPy in a loop':32} {count / scipy:8.0f} a second, {scipy / ours:.0f} times longer")
    try:
        from joblib import Parallel, delayed
    except ImportError:
        return
    with Parallel(n_jobs=2) as pool:

        def spread() -> None:
            part = np.array_split(np.arange(count), 8)
            solve = sl.solve_continuous_are
            pool(delayed(lambda i: [solve(a[k], b[k], q, r) for k in i])(i) for i in part)

        spread()
        joblib = best(spread, 1, 2)
    print(f"{'joblib, two processes':32} {count / joblib:8.0f} a second, {joblib / ours:.0f} times longer")


def shards(quick: bool) -> None:
    """A study in 1,000 shards beside the same in one, in this process."""
    if not hasattr(pymmae, "sweep"):
        return
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
    more = took[1] - took[0]
    print(f"{f'{count} shards of {took[0] / count:.3f} s':32} {1e3 * more / count:8.2f} ms more a shard")
    print(f"{'':32} {100 * more / count:8.2f} % of a shard of one second")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small sizes, as a test")
    quick = parser.parse_args().quick
    print(f"pymmae {pymmae.VERSION}, {pymmae.CPU_TIER}, NumPy {np.__version__}")
    for part in (overhead, copies, threads, peers, shards):
        part(quick)


if __name__ == "__main__":
    main()
