"""Tasks on the workers of a Dask cluster."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Any

from . import _core
from ._child import Outcome
from ._tasks import Job, hello
from .errors import DTypeError, SweepError


def greet(client: Any) -> list[str]:
    """Asks every worker who it is; returns the instruction sets of their CPUs.

    Raises ``SweepError`` for one without the package, or of another version.
    """
    if not hasattr(client, "submit") or not hasattr(client, "run"):
        raise DTypeError("client: give a dask.distributed.Client, or None", "dtype")
    client.wait_for_workers(1, timeout=60)
    answers: dict[str, Any] = client.run(hello, on_error="return")
    # a worker that went away meanwhile has nothing to say
    answers = {worker: who for worker, who in answers.items() if not isinstance(who, OSError)}
    for worker, who in answers.items():
        if isinstance(who, Exception):
            raise SweepError(
                f"worker {worker} does not answer ({type(who).__name__}: {who}): install pymmae "
                "there",
                "version",
            )
        if who["version"] != _core.VERSION:
            raise SweepError(
                f"worker {worker} has pymmae {who['version']}, the driver {_core.VERSION}: "
                "install the same on all",
                "version",
            )
    return [who["cpu_tier"] for who in answers.values()]


def on_workers(client: Any, job: Job, run: Callable[[Job, int], Outcome]) -> Any:
    """All tasks at once; those to be done again as they are sent.

    A task that Dask gives up because workers died under it is ``lost``: Dask blames every
    task that a worker held, the engine's tasks never take one with them.
    """
    import distributed

    sweep = uuid.uuid4().hex[:12]
    tasks: dict[str, int] = {}

    def submit(task: int) -> Any:
        # a key of its own each time: Dask would answer a known one from memory
        key = f"pymmae-{sweep}-{task}-{len(tasks)}"
        tasks[key] = task
        return client.submit(run, job, task, key=key, pure=False, retries=0)

    completed: Any = distributed.as_completed
    running = completed([submit(task) for task in range(1, job.shards + 1)])
    try:
        for future in running:
            task = tasks[future.key]
            if future.status == "finished":
                answer = future.result()
                outcome = {**answer, "of": answer["task"], "task": task}
            elif client.status in ("closed", "closing"):
                raise SweepError("the scheduler is gone: call again, which resumes", "scheduler")
            else:
                outcome = {"status": "lost", "task": task}
            again = yield outcome
            if again is not None:
                running.add(submit(again))
    finally:
        for future in list(running.futures):
            future.cancel()
