"""Threads, signals, processes, memory: calls as the interpreter sees them."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import resource
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pymmae
import pytest
from conftest import MOTOR, SMALL
from pymmae import _core


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("apart", [False, True])
def test_a_panic_is_a_plain_exception(apart):
    with pytest.raises(pymmae.InternalError, match="on purpose") as caught:
        _core._panic(apart)
    assert isinstance(caught.value, Exception)


def test_ctrl_c_answers_within_half_a_second():
    done = run(
        """
        import os, signal, threading, time
        from pymmae import _core
        # a job in the background is started deaf to it
        signal.signal(signal.SIGINT, signal.default_int_handler)
        def press():
            time.sleep(0.5)
            global pressed
            pressed = time.monotonic()
            os.kill(os.getpid(), signal.SIGINT)
        threading.Thread(target=press).start()
        try:
            _core._wait(30.0)
        except KeyboardInterrupt:
            print(time.monotonic() - pressed)
        """
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0.5


def test_ctrl_c_stops_a_study():
    done = run(
        """
        import os, signal, threading, time
        import pymmae
        signal.signal(signal.SIGINT, signal.default_int_handler)
        scenario = {"plant": {"family": "pendulum"}, "bank": {"models": {"L": [1.0, 1.5]}},
                    "eip": {"grid": {"L": {"from": 0.9, "to": 1.9, "points": 5_000_001}}}}
        threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
        try:
            pymmae.eip(scenario)
        except KeyboardInterrupt:
            print("stopped")
        """
    )
    assert done.stdout == "stopped\n", done.stderr


def test_an_exception_of_the_callback_ends_the_call():
    def refuse(done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        _core._wait(10.0, refuse)


def test_progress_rises_to_the_total():
    seen = []
    pymmae.monte_carlo(SMALL, trials=5000, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (5000, 5000)
    assert all(a[0] < b[0] for a, b in zip(seen, seen[1:]))


def test_the_lock_is_released():
    seen = []

    def count():
        while not done.is_set():
            seen.append(1)
            time.sleep(0.001)

    done = threading.Event()
    other = threading.Thread(target=count)
    other.start()
    _core._wait(0.3)
    done.set()
    other.join()
    assert len(seen) > 20


def test_four_threads_agree_with_one():
    rng = np.random.default_rng(1)
    a = rng.standard_normal((4, 500, 4, 4))
    q = np.eye(4)
    want = [pymmae.care(x, q, q, q).X for x in a]
    got = [None] * 4

    def work(k):
        for _ in range(5):
            got[k] = pymmae.care(a[k], q, q, q, threads=1 + k % 2).X

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert all((x == y).all() for x, y in zip(got, want))


def test_an_array_that_another_thread_writes_to():
    """It is copied first: the answer is that of some moment, item by item."""
    a = np.tile(-np.eye(3), (2000, 1, 1))
    stop = threading.Event()

    def write():
        while not stop.is_set():
            a[:, 0, 1] = 0.25
            a[:, 0, 1] = 0.0

    other = threading.Thread(target=write)
    other.start()
    for _ in range(20):
        assert not pymmae.lyap(a, np.eye(3)).failed.any()
    stop.set()
    other.join()


def _child(queue):
    queue.put(float(pymmae.monte_carlo(SMALL, trials=3000).p[-1, 1]))


def test_a_forked_process_works():
    want = float(pymmae.monte_carlo(SMALL, trials=3000, threads=2).p[-1, 1])
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_child, args=(queue,))
    child.start()
    assert queue.get(timeout=60) == want
    child.join(60)


def test_another_interpreter_refuses_the_module():
    done = run(
        """
        import sys
        try:
            import _xxsubinterpreters as sub
            run = lambda code: sub.run_string(sub.create(), code)
        except ImportError:
            try:
                import _interpreters as sub
            except ImportError:
                sys.exit(0)
            run = lambda code: sub.exec(sub.create("legacy"), code)
        import pymmae._core
        try:
            trouble = run("import pymmae._core")
        except Exception as error:
            trouble = error
        print("ImportError" in str(trouble))
        """
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout in ("True\\n", "True\n", "")


def test_errors_and_scenarios_pickle():
    scenario = pymmae.Scenario(SMALL, units={"x": "m"})
    again = pickle.loads(pickle.dumps(scenario))
    assert again.text == scenario.text and again.units == {"x": "m"}
    first, second = pymmae.eip(scenario), pymmae.eip(again)
    assert first.attrs["sha256"] == second.attrs["sha256"]
    assert pickle.loads(pickle.dumps(first)).identical(first)
    try:
        pymmae.Scenario.parse("x = 1")
    except pymmae.ScenarioError as error:
        copy = pickle.loads(pickle.dumps(error))
        assert copy.diagnostics == error.diagnostics and str(copy) == str(error)


EYE = np.eye(2)
BAD = np.array([[np.nan, 0], [0, 1]])


def quiet(call):
    try:
        call()
    except pymmae.Error:
        pass


SCENARIO, OBSERVER = pymmae.Scenario(SMALL), pymmae.Scenario(MOTOR)
Y = np.zeros((8, 1))
REPEATED = {
    "care": (10_000, lambda: pymmae.care(-EYE, EYE, EYE, EYE)),
    "dare": (10_000, lambda: pymmae.dare(EYE, EYE, EYE, EYE)),
    "lyap": (10_000, lambda: pymmae.lyap(-EYE, EYE)),
    "sylvester": (10_000, lambda: pymmae.sylvester(-EYE, -EYE, EYE)),
    "riccati_ode": (10_000, lambda: pymmae.riccati_ode(EYE, EYE, EYE, EYE, EYE, 0.1)),
    "care refused": (10_000, lambda: quiet(lambda: pymmae.care(BAD, EYE, EYE, EYE))),
    "care unsolvable": (10_000, lambda: quiet(lambda: pymmae.care(EYE, 0 * EYE, EYE, EYE))),
    "lyap of text": (10_000, lambda: quiet(lambda: pymmae.lyap("a", EYE))),
    "eip": (10_000, lambda: _core.eip(SCENARIO._core, 1, None)),
    "place refused": (
        10_000,
        lambda: quiet(lambda: _core.place(SCENARIO._core, 0, None, None, None, 1)),
    ),
    "estimate": (10_000, lambda: _core.estimate(SCENARIO._core, Y, None, None, None)),
    "trials": (
        10_000,
        lambda: _core.trials(SCENARIO._core, [], None, None, None, 1, 1, None),
    ),
    "scenario": (10_000, lambda: _core.Scenario("s", SCENARIO.text)),
    "adaptive": (
        3000,
        lambda: _core.adaptive_records(OBSERVER._core, None, {}, Y, Y, None, 1, 0.02, 1, None),
    ),
}
#: Calls that make datasets. Most of their time is xarray's, a few milliseconds each.
LABELLED = {
    "eip": lambda: pymmae.eip(SCENARIO),
    "run": lambda: pymmae.run(SCENARIO),
    "monte_carlo": lambda: pymmae.monte_carlo(SCENARIO),
    "estimate": lambda: pymmae.estimate(SCENARIO, Y),
    "adaptive": lambda: pymmae.adaptive(OBSERVER, Y, Y),
}
#: Calls of each; ``MMAE_LABELLED_CALLS=10000`` takes minutes.
CALLS = int(os.environ.get("MMAE_LABELLED_CALLS", "500"))


def resident() -> int:
    """Bytes of memory in use, where the system tells."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@pytest.mark.parametrize("name", REPEATED)
def test_memory_stays_flat(name):
    count, call = REPEATED[name]
    for _ in range(count // 10):
        call()
    gc.collect()
    before, counts = resident(), [sys.getrefcount(x) for x in (EYE, BAD, Y, None)]
    for _ in range(count):
        call()
    gc.collect()
    assert resident() - before <= 5 << 20
    after = [sys.getrefcount(x) for x in (EYE, BAD, Y)]
    assert after == counts[:3]


@pytest.mark.parametrize("name", LABELLED)
def test_memory_of_datasets_stays_flat(name):
    """Resident memory, and the interpreter's own count of blocks: less than one a call."""
    call = LABELLED[name]
    for _ in range(200):
        call()
    gc.collect()
    before, blocks = resident(), sys.getallocatedblocks()
    for _ in range(CALLS):
        call()
    gc.collect()
    assert resident() - before <= 5 << 20
    assert sys.getallocatedblocks() - blocks < CALLS
