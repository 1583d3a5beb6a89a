"""A task of a sweep: one shard of a study, computed into a directory of its own.

Runs where the shard is computed: in the driver, in a worker, in a child of a worker.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from . import _core
from .errors import Error, SweepError
from .family import Family

#: Seconds to wait for another process that computes the same shard.
PATIENCE = 3600.0


@dataclass(frozen=True, eq=False)
class Job:
    """What all tasks of a sweep have in common."""

    name: str
    text: str
    family: Family | None
    #: Identity of the plants beside the text, for the digest of the study.
    salt: bytes
    folder: str
    shards: int
    block: int | None
    refine: bool
    threads: int
    version: str
    timeout: float | None
    #: Faults by task, for tests.
    faults: dict[int, str] = field(default_factory=dict)

    def core(self) -> Any:
        """The scenario, in this process."""
        raw = None if self.family is None else self.family._raw()
        return _core.Scenario(self.name, self.text, raw)

    def directory(self, task: int) -> Path:
        """Where a task writes."""
        return Path(self.folder) / f"shard-{task:06}-of-{self.shards:06}"


def hello() -> dict[str, Any]:
    """Who works here."""
    return {"version": _core.VERSION, "cpu_tier": _core.CPU_TIER, "pid": os.getpid()}


def perform(job: Job, task: int) -> dict[str, Any]:
    """Computes shard ``task`` (from 1); what is there already is kept.

    Returns the task, its directory and the digest of its manifest; never results.
    """
    if job.version != _core.VERSION:
        raise SweepError(
            f"this worker has pymmae {_core.VERSION}, the driver {job.version}: install the same",
            "version",
        )
    fault = job.faults.get(task)
    if fault is not None:
        _fail(fault)
    began = time.monotonic()
    core, directory = job.core(), job.directory(task)
    directory.mkdir(parents=True, exist_ok=True)
    while True:
        try:
            done: dict[str, Any] = _core.shard(
                core,
                job.salt,
                job.block,
                job.refine,
                task,
                job.shards,
                str(directory),
                job.threads,
            )
            break
        except Error as error:
            # the same task, delivered twice: the other one ends, and all is there
            waited = time.monotonic() - began
            if error.code != "locked" or waited > (job.timeout or PATIENCE):
                raise
            time.sleep(0.02)
    if fault == "other":
        task += 1
    return {"task": task, "seconds": time.monotonic() - began, **done, **hello()}


def _fail(fault: str) -> None:
    """Faults that tests ask for."""
    if fault == "raise":
        raise SweepError("on purpose", "test")
    if fault == "abort":
        os.abort()
    while fault == "loop":
        time.sleep(0.05)
    # takes its time as long as a file is there
    if fault.startswith("slow ") and os.path.exists(fault.removeprefix("slow ")):
        time.sleep(0.4)
