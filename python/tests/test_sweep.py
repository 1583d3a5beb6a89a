"""Sweeps: the same bytes however they are computed, whatever happens on the way."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pymmae
import pytest
from pymmae._child import Child, outcome
from pymmae._tasks import Job, perform

TEXT = """\
format = 1
[plant]
family = "pendulum"
[bank]
models = { L = [1.025, 1.287, 1.526, 1.778] }
[eip]
grid = { L = { from = 0.9, to = 1.9, points = 1601 } }
verify = "none"
"""
STUDY = pymmae.Scenario.parse(TEXT)
BLOCK = 8


@pytest.fixture(scope="module")
def digest(tmp_path_factory) -> str:
    """Of the whole in one shard, here."""
    done = pymmae.sweep(STUDY, tmp_path_factory.mktemp("whole") / "out", block=BLOCK, shards=1)
    assert done.tasks == 1 and done.computed == 201
    return done.sha256


@pytest.fixture(scope="module")
def cluster():
    import dask
    from distributed import Client, LocalCluster

    dask.config.set({"distributed.comm.timeouts.connect": "30s"})
    # Dask's own patience with deaths is short, as by default
    dask.config.set({"distributed.scheduler.allowed-failures": 3})
    options = dict(threads_per_worker=1, host="127.0.0.1", dashboard_address=None)
    cluster = LocalCluster(n_workers=2, **options)
    client = Client(cluster)
    yield cluster, client
    client.close()
    # Dask has lost count of workers that were killed
    with contextlib.suppress(KeyError):
        cluster.close()


def job(folder, shards=4, **changes) -> Job:
    values = dict(name="scenario", text=TEXT, family=None, salt=b"", folder=str(folder))
    values |= dict(shards=shards, block=BLOCK, refine=False, threads=1, timeout=None)
    return Job(**values, version=pymmae.VERSION, **changes)


def test_any_number_of_shards_gives_the_same_bytes(digest, tmp_path):
    seen = []
    done = pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=7, threads=2,
                        progress=lambda d, n: seen.append((d, n)))  # fmt: skip
    assert done.sha256 == digest and done.path == tmp_path / "out"
    assert seen == [(k, 7) for k in range(1, 8)]
    assert not (tmp_path / "out.shards").exists()
    again = pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=7)
    assert again.sha256 == digest and again.computed == 0 and again.kept == 201


def test_shards_of_the_command_are_the_same(digest, command, tmp_path):
    (tmp_path / "study.toml").write_text(TEXT)
    folders = []
    for k in (1, 2):
        folders.append(tmp_path / f"shard{k}")
        arguments = [command, "eip", tmp_path / "study.toml", "--shard", f"{k}/2"]
        arguments += ["--block", str(BLOCK), "--out", folders[-1]]
        subprocess.run(arguments, check=True, capture_output=True)
    from pymmae import _core

    assert _core.merge([str(f) for f in folders], str(tmp_path / "out"), False) == digest


def test_tasks_out_of_order_and_delivered_twice(digest, tmp_path):
    here = job(tmp_path)
    first = [perform(here, task) for task in (3, 1, 4, 2)]
    second = perform(here, 3)
    assert second["sha256"] == first[0]["sha256"] and second["computed"] == 0
    both = [threading.Thread(target=perform, args=(job(tmp_path / "b", 1), 1)) for _ in range(3)]
    [t.start() for t in both]
    [t.join() for t in both]
    done = pymmae.sweep(STUDY, tmp_path / "b-out", block=BLOCK, shards=1)
    assert done.sha256 == digest


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_workers_give_the_same_bytes(digest, cluster, workers, tmp_path):
    local, client = cluster
    local.scale(workers)
    client.wait_for_workers(workers, timeout=60)
    done = pymmae.sweep(STUDY, tmp_path / "out", client, block=BLOCK, shards=20)
    assert done.sha256 == digest and done.tasks == 20 and done.computed == 201
    assert done.cpu_tiers == (pymmae.CPU_TIER,)


def test_a_worker_is_killed_every_two_seconds(digest, cluster, tmp_path):
    """For twenty seconds one dies that is at work, and another takes over."""
    local, client = cluster
    local.scale(2)
    client.wait_for_workers(2, timeout=60)
    flag = tmp_path / "flag"
    flag.touch()
    killed: list[int] = []

    def victim() -> int | None:
        for nanny in list(local.workers.values()):
            # one that is starting is not started again by Dask
            if nanny.status.name == "running" and nanny.process and nanny.process.pid:
                if nanny.process.pid not in killed:
                    return int(nanny.process.pid)
        return None

    def kill() -> None:
        for tick in range(1, 11):
            time.sleep(max(0.0, began + 2 * tick - time.monotonic()))
            while (pid := victim()) is None and time.monotonic() < began + 20:
                time.sleep(0.05)
            if pid is not None:
                killed.append(pid)
                os.kill(pid, signal.SIGKILL)
        flag.unlink()

    began = time.monotonic()
    killer = threading.Thread(target=kill)
    killer.start()
    # 100 tasks of 0.4 s on two workers: the last is not done before the last is killed
    slow = dict.fromkeys(range(1, 101), f"slow {flag}")
    done = pymmae.sweep(STUDY, tmp_path / "out", client, block=BLOCK, shards=100, _faults=slow)
    killer.join()
    assert done.seconds > 20 and len(killed) >= 6  # ten, unless workers start slowly
    assert done.sha256 == digest and not done.failed and done.tasks == 100


def test_poison_is_left_out_and_named(digest, tmp_path):
    faults = {17: "raise", 50: "abort", 133: "loop"}
    with pytest.raises(pymmae.SweepError) as caught:
        pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=200, isolate=True, timeout=3,
                     _faults=faults)  # fmt: skip
    error = caught.value
    assert list(error.failed) == [17, 50, 133]
    assert "on purpose" in error.failed[17] and "SIGABRT" in error.failed[50]
    assert "3 s" in error.failed[133] and "17: " in str(error)
    assert error.result.tasks == 200 and error.result.retried == 6
    assert pickle.loads(pickle.dumps(error)).failed == error.failed
    # without the cause the rest is computed, and no more
    done = pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=200)
    assert done.sha256 == digest and done.computed == 201 - error.result.computed


def test_poison_on_workers(digest, cluster, tmp_path):
    _, client = cluster
    client.wait_for_workers(1, timeout=60)
    with pytest.raises(pymmae.SweepError) as caught:
        pymmae.sweep(STUDY, tmp_path / "out", client, block=BLOCK, shards=30,
                     _faults={5: "abort", 9: "other"})  # fmt: skip
    assert list(caught.value.failed) == [5, 9]
    assert "task 10" in caught.value.failed[9]
    assert caught.value.result.deaths == 0  # no worker died of it


def test_the_driver_is_killed_and_resumes(digest, tmp_path):
    code = textwrap.dedent(
        f"""
        import pymmae
        pymmae.sweep(pymmae.Scenario.parse({TEXT!r}), {str(tmp_path / "out")!r}, block={BLOCK},
                     shards=67, progress=lambda d, n: print(d, flush=True))
        """
    )
    for after in (1, 20, 45):
        driver = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
        assert driver.stdout is not None
        for line in driver.stdout:
            if int(line) >= after:
                break
        driver.kill()
        driver.wait()
    done = pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=67)
    assert done.sha256 == digest and done.kept >= 45 and done.computed < 201


def test_a_damaged_part_is_computed_again(digest, tmp_path):
    here = job(tmp_path / "out.shards")
    done = [perform(here, task) for task in range(1, 5)]
    parts = sorted((tmp_path / "out.shards").rglob("*.parquet"))
    parts[0].write_bytes(parts[0].read_bytes()[:100])
    parts[-1].unlink()
    assert len(done) == 4
    again = pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=4)
    assert again.sha256 == digest and 1 <= again.computed <= 2


def test_another_study_is_not_mixed_in(tmp_path):
    pymmae.sweep(STUDY, tmp_path / "out", block=BLOCK, shards=2)
    other = STUDY.updated({"bank": {"models": {"L": [1.0, 1.5]}}})
    with pytest.raises(pymmae.FileError, match="another"):
        pymmae.sweep(other, tmp_path / "out", block=BLOCK, shards=2)
    assert not (tmp_path / "out.shards").exists()
    done = pymmae.sweep(other, tmp_path / "out", block=BLOCK, shards=2, force=True)
    assert done.computed == 201


def test_versions_that_differ_are_refused(tmp_path):
    with pytest.raises(pymmae.SweepError, match="install the same"):
        perform(Job(**{**vars(job(tmp_path)), "version": "0.0.0"}), 1)
    from pymmae._dask import greet

    class Client:
        def submit(self):
            """Never called."""

        def wait_for_workers(self, count, timeout):
            """There is one."""

        def run(self, function, on_error):
            return {"tcp://1": {"version": "0.0.0", "cpu_tier": "base", "pid": 1}}

    with pytest.raises(pymmae.SweepError, match="tcp://1 has pymmae 0.0.0"):
        greet(Client())


def test_a_family_of_matrices_in_shards(tmp_path):
    axes = {"k": np.linspace(0.5, 2.0, 40)}

    def plant(k):
        return {"A": [[0, 1], [-k, -0.3]], "C": [[1, 0]], "R": [[0.01]]}

    tables = {"bank": {"models": {"k": [0.5, 2.0]}}, "eip": {"grid": axes}}
    family = pymmae.Family.from_function(plant, axes)
    scenario = pymmae.Scenario(tables, family=family)
    one = pymmae.sweep(scenario, tmp_path / "one", block=8)
    two = pymmae.sweep(scenario, tmp_path / "two", block=8, shards=2, isolate=True)
    assert one.sha256 == two.sha256
    stiff = pymmae.Family.from_function(lambda k: plant(2 * k), axes)
    other = pymmae.sweep(pymmae.Scenario(tables, family=stiff), tmp_path / "three", block=8)
    assert other.sha256 != one.sha256


def test_a_child_reports_what_happens_to_it(tmp_path):
    child = Child()
    try:
        here = job(tmp_path, faults={2: "raise"})
        assert child.run(here, 1)["status"] == "done"
        assert child.run(here, 2)["status"] == "raised" == outcome(here, 2)["status"]
        os.kill(child._process.pid, signal.SIGKILL)
        time.sleep(0.1)
        assert child.run(here, 3)["status"] == "died" and not child.alive
    finally:
        child.close()


@pytest.mark.parametrize("change", [{"shards": 0}, {"tries": 0}, {"client": 3}, {"block": 0}])
def test_settings_that_are_wrong(change, tmp_path):
    with pytest.raises(pymmae.Error):
        pymmae.sweep(STUDY, tmp_path / "out", **change)
