"""Sweeps: a study in shards, here or on the workers of a Dask cluster."""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from . import _core
from ._child import Outcome, isolated, outcome
from ._progress import Progress, reporting
from ._tasks import Job
from .errors import FileError, InputError, SweepError
from .family import Family
from .scenario import ScenarioLike, scenario_of

#: Shards where nobody says how many: enough for workers to come and go.
_SHARDS = 256


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep has done, see :func:`sweep`."""

    #: Directory of the merged result; of the shards where some failed.
    path: Path
    #: Digest of the merged manifest, which holds those of all files; empty where some failed.
    sha256: str
    #: Number of tasks, each a shard.
    tasks: int
    #: Blocks that were computed in this call.
    computed: int
    #: Blocks that were there already.
    kept: int
    #: Tasks that came to nothing, by number, and why.
    failed: dict[int, str] = field(default_factory=dict)
    #: Tries that came to nothing and were made good by another.
    retried: int = 0
    #: Times a worker died under a task.
    deaths: int = 0
    #: Instruction sets of the CPUs that computed: the bits are the same on each.
    cpu_tiers: tuple[str, ...] = ()
    #: Seconds in all.
    seconds: float = 0.0


def sweep(
    scenario: ScenarioLike,
    out: str | os.PathLike[str],
    client: Any = None,
    *,
    shards: int | None = None,
    block: int | None = None,
    refine: bool = False,
    threads: int | None = None,
    tries: int = 3,
    worker_deaths: int = 100,
    timeout: float | None = None,
    isolate: bool | None = None,
    progress: Progress = None,
    force: bool = False,
    keep_shards: bool = False,
    _faults: dict[int, str] | None = None,
) -> Sweep:
    """The EIP study of a scenario in shards, joined in directory ``out``.

    .. code-block:: text

        blocks of the grid -> shards -> tasks -> parts with digests -> merge -> out/manifest.json

    With ``client=None`` the shards are computed here, one after the other; with a Dask
    client on its workers, which must see the same file system. The result is that of
    ``mmae eip --shard i/n`` and ``mmae merge``: the same bytes for any number of shards,
    workers, threads and interruptions, whose digest is ``sha256``. Shards stand in a
    directory beside ``out`` (its name and ``.shards``) until all are there; a call after an
    interruption computes what is missing, and a call after the end does nothing.

    ``threads`` are those of each task: one on workers, all here, unless stated (Dask does
    not limit the engine's threads). ``block`` and ``refine`` are those of the command.

    A task that fails (an exception, a crash, more than ``timeout`` seconds, an answer
    that is not its own) is tried again, up to ``tries`` times in all, and is then left
    out. Tasks run in a child process each worker thread keeps (``isolate``; here only if
    asked for), so that a crash takes no worker with it; the death of a worker is nobody's
    fault and is counted apart (``worker_deaths`` a task). Workers of another version are
    refused.

    Source: the shard protocol of the guide, page "results".

    Raises ``SweepError`` with ``failed`` and ``result`` if tasks were left out; the others
    are done, and a later call tries them alone. Other errors as :func:`pymmae.eip`.

    >>> import pymmae, tempfile
    >>> study = {"plant": {"family": "pendulum"}, "bank": {"models": {"L": [1.0, 1.5]}},
    ...          "eip": {"grid": {"L": {"from": 0.9, "to": 1.9, "points": 41}}}}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     one = pymmae.sweep(study, f"{folder}/one", block=8)
    ...     two = pymmae.sweep(study, f"{folder}/two", block=8, shards=2)
    >>> one.sha256 == two.sha256, one.tasks, two.tasks
    (True, 6, 2)
    """
    began = time.monotonic()
    if tries < 1:
        raise InputError(f"tries = {tries} is out of range: give at least one", "range")
    taken = scenario_of(scenario)
    salt = b"" if taken.family is None else _digest(taken.family)
    blocks = _core.blocks(taken._core, salt, block, refine)
    count = min(blocks, _SHARDS) if shards is None else shards
    if count < 1:
        raise InputError(f"shards = {count} is out of range: give at least one", "range")
    target = Path(os.path.abspath(os.fspath(out)))
    folder = target.with_name(target.name + ".shards")
    job = Job(
        name=taken.name,
        text=taken.text,
        family=taken.family,
        salt=salt,
        folder=str(folder),
        shards=count,
        block=block,
        refine=refine,
        threads=threads if threads is not None else (0 if client is None else 1),
        version=_core.VERSION,
        timeout=timeout,
        faults=dict(_faults or {}),
    )
    if force:
        shutil.rmtree(folder, ignore_errors=True)
    else:
        there = _core.complete(taken._core, salt, block, refine, str(target))
        if there is not None:
            return Sweep(target, there, count, 0, blocks, seconds=time.monotonic() - began)
        if (target / "manifest.json").exists():
            raise FileError(
                f"{target} holds another result, or not the whole of this one: choose another "
                "directory, or replace it with force=True",
                "present",
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: {error.strerror}: choose another directory", "write") from None
    book = _Book(job, tries, worker_deaths)
    if client is None:
        book.tiers.add(_core.CPU_TIER)
        source = _here(job, isolated if isolate else outcome)
    else:
        from ._dask import greet, on_workers

        book.tiers.update(greet(client))
        source = on_workers(client, job, outcome if isolate is False else isolated)
    with reporting(progress, "shard") as tell:
        book.settle(source, tell)
    facts: dict[str, Any] = {
        "tasks": count,
        "computed": book.computed,
        "kept": book.kept,
        "failed": book.failed,
        "retried": book.retried,
        "deaths": book.deaths,
        "cpu_tiers": tuple(sorted(book.tiers)),
    }
    if book.failed:
        rest = Sweep(folder, "", **facts, seconds=time.monotonic() - began)
        raise _left_out(book.failed, count, rest)
    directories = [str(job.directory(task)) for task in range(1, count + 1)]
    if force:
        # the earlier result goes when the new one is there, and nothing else with it
        for table in ("plants", "upsilon"):
            shutil.rmtree(target / table, ignore_errors=True)
        (target / "manifest.json").unlink(missing_ok=True)
    sha256 = _core.merge(directories, str(target), force)
    if not keep_shards:
        shutil.rmtree(folder, ignore_errors=True)
    return Sweep(target, sha256, **facts, seconds=time.monotonic() - began)


def _digest(family: Family) -> bytes:
    """What tells a family that is given by matrices from any other."""
    digest = hashlib.sha256(repr((family.names, family.dt, family.nominal)).encode())
    for name, array in [*family.axes.items(), *family.matrices.items()]:
        digest.update(f"{name} {array.shape} ".encode() + array.tobytes())
    return digest.digest()


def _left_out(failed: dict[int, str], count: int, rest: Sweep) -> SweepError:
    named = "; ".join(f"{task}: {reason}" for task, reason in sorted(failed.items())[:10])
    more = "" if len(failed) <= 10 else f"; and {len(failed) - 10} more"
    error = SweepError(
        f"{len(failed)} of {count} tasks came to nothing, the others are done: {named}{more}: "
        "remove the cause and call again, which computes what is missing"
    )
    error.failed, error.result = dict(sorted(failed.items())), rest
    return error


#: Takes tasks to do again, gives what became of some.
Source = Iterator[Outcome]


class _Book:
    """Who has done what, and who may try again."""

    def __init__(self, job: Job, tries: int, worker_deaths: int) -> None:
        self.job, self.tries, self.worker_deaths = job, tries, worker_deaths
        self.left = set(range(1, job.shards + 1))
        self.failed: dict[int, str] = {}
        self.tiers: set[str] = set()
        self.computed = self.kept = self.retried = self.deaths = 0
        self._tried: dict[int, int] = {}
        self._died: dict[int, int] = {}

    def settle(self, source: Any, tell: Callable[[int, int], object] | None) -> None:
        """Takes what becomes of tasks until each is done or left out."""
        answer = next(source)
        while True:
            again = self._take(answer)
            if not again and tell is not None:
                tell(self.job.shards - len(self.left), self.job.shards)
            if not self.left:
                source.close()
                return
            answer = source.send(answer["task"] if again else None)

    def _take(self, answer: Outcome) -> bool:
        """Enters an answer; True if its task is to be done again."""
        task, status = answer["task"], answer["status"]
        if task not in self.left:
            return False  # delivered twice
        if status == "lost":
            self.deaths += 1
            count = self._died[task] = self._died.get(task, 0) + 1
            if count <= self.worker_deaths:
                return True
            self._leave(task, f"its worker died {count} times")
            return False
        wrong = self._wrong(task, answer) if status == "done" else answer["reason"]
        if wrong is None:
            self.computed += answer["computed"]
            self.kept += answer["kept"]
            self.tiers.add(answer["cpu_tier"])
            self.left.discard(task)
            return False
        count = self._tried[task] = self._tried.get(task, 0) + 1
        if count < self.tries:
            self.retried += 1
            return True
        self._leave(task, wrong)
        return False

    def _leave(self, task: int, reason: str) -> None:
        self.left.discard(task)
        self.failed[task] = reason

    def _wrong(self, task: int, answer: Outcome) -> str | None:
        """Why an answer is not that of its task; the parts are checked by the merge."""
        if answer.get("of") != task:
            return f"the answer is that of task {answer.get('of')}"
        if answer.get("version") != self.job.version:
            return f"it was computed by pymmae {answer.get('version')}"
        try:
            with open(self.job.directory(task) / "manifest.json", "rb") as file:
                found = hashlib.sha256(file.read()).hexdigest()
        except OSError as error:
            return f"its manifest cannot be read: {error}: workers must see the same files"
        return None if found == answer.get("sha256") else "its manifest is not what it returned"


def _here(job: Job, run: Callable[[Job, int], Outcome]) -> Any:
    """Tasks one after the other; those to be done again come last."""
    todo = list(range(1, job.shards + 1))
    for task in todo:
        answer = run(job, task)
        again = yield {**answer, "of": answer["task"], "task": task}
        if again is not None:
            todo.append(again)
