"""A child process that computes shards, so that one that crashes takes nothing with it.

The child lives as long as its parent, and longer than a task: it is started once.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from typing import Any, BinaryIO

from ._tasks import Job, perform
from .errors import Error

#: ``{"status": "done" | "raised" | "died" | "timeout", ...}``
Outcome = dict[str, Any]


def outcome(job: Job, task: int) -> Outcome:
    """What became of a task in this process; only interrupts are raised."""
    try:
        return {"status": "done", **perform(job, task)}
    except Exception as error:
        code = error.code if isinstance(error, Error) else "error"
        reason = f"{type(error).__name__}: {error}"
        return {"status": "raised", "task": task, "reason": reason, "code": code}


class Child:
    """One process, one task at a time."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "pymmae._child"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._answers: queue.SimpleQueue[Outcome | None] = queue.SimpleQueue()
        threading.Thread(target=self._listen, daemon=True).start()
        # the time that it takes to start is not that of a task
        self._answers.get()

    def _listen(self) -> None:
        stream = self._process.stdout
        try:
            while stream is not None:
                self._answers.put(pickle.load(stream))
        except (EOFError, pickle.UnpicklingError, OSError, ValueError):
            self._answers.put(None)

    @property
    def alive(self) -> bool:
        """Whether it can take a task."""
        return self._process.poll() is None

    def run(self, job: Job, task: int) -> Outcome:
        """Sends a task and waits for what becomes of it."""
        stream = self._process.stdin
        assert stream is not None
        try:
            pickle.dump((job, task), stream)
            stream.flush()
            answer = self._answers.get(timeout=job.timeout)
        except queue.Empty:
            self.close()
            reason = f"it took more than {job.timeout} s"
            return {"status": "timeout", "task": task, "reason": reason}
        except OSError:
            answer = None
        except BaseException:
            # an interrupt: the task goes on nowhere
            self.close()
            raise
        if answer is not None:
            return answer
        code = self._process.wait()
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return {"status": "died", "task": task, "reason": f"its process died: {name}"}

    def close(self) -> None:
        """Ends the process, whatever it does."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                try:
                    stream.close()
                except OSError:
                    pass


_mine = threading.local()


def isolated(job: Job, task: int) -> Outcome:
    """:func:`outcome` in the child of this thread, a new one if the last has died."""
    child: Child | None = getattr(_mine, "child", None)
    if child is None or not child.alive:
        child = _mine.child = Child()
    return child.run(job, task)


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    todo: queue.SimpleQueue[tuple[Job, int]] = queue.SimpleQueue()

    def listen() -> None:
        try:
            while True:
                todo.put(pickle.load(requests))
        except BaseException:
            # the parent has gone: so does its work
            os._exit(0)

    threading.Thread(target=listen, daemon=True).start()
    answer: Outcome = {"status": "ready"}
    while True:
        pickle.dump(answer, answers)
        answers.flush()
        answer = outcome(*todo.get())


if __name__ == "__main__":
    # Ctrl-C is for the parent; what is printed must not mix with the answers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stream = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _serve(sys.stdin.buffer, stream)
