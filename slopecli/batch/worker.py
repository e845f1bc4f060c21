"""An executor of one child process with limits on time and memory, which is restarted after a crash."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, Any, ParamSpec, TypeVar

from slopecli.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")

HEADER = struct.Struct("<Q")  # length of the pickle that follows
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SERVE = "import sys; from slopecli.batch.worker import serve; serve(int(sys.argv[1]))"


class WorkerFailed(Exception):
    """A call ended its process; `code` is that of an `Outcome`."""

    code = "crashed"


class WorkerCrashed(WorkerFailed):
    """The process ended during a call."""


class WorkerTimeout(WorkerFailed):
    """A call exceeded the time limit, and its process was killed."""

    code = "timeout"


@dataclass(frozen=True)
class Limits:
    """Limits of a worker process.

    timeout_s : of a call; its future raises `WorkerTimeout` when it is exceeded.
    memory_gb : of the process, 1e9 bytes; calls that need more raise MemoryError or crash. Linux only.
    """

    timeout_s: float | None = None
    memory_gb: float | None = None

    def __post_init__(self) -> None:
        if self.memory_gb is not None and sys.platform != "linux":
            raise InputError("--memory: the memory of a process can be limited on Linux only; leave it out")


NO_LIMITS = Limits()


class Worker(Executor):
    """Calls functions one after the other in one child process.

    The process computes in one thread. It starts with the first call, is restarted after a crash, and ends when this
    process does, even if this one is killed. It ignores SIGINT, which this process handles.

    Parameters
    ----------
    limits : of time and memory.
    inherit : file descriptors that the process keeps open, such as that of a lock.

    A future raises `WorkerCrashed` if the process ends during its call, `BrokenExecutor` if no process can be started.
    """

    def __init__(self, limits: Limits = NO_LIMITS, *, inherit: Sequence[int] = ()) -> None:
        self._limits = limits
        self._inherit = tuple(inherit) if os.name == "posix" else ()
        self._calls: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False
        self._starting = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Queue a call of `fn` in the process, pickled at once; its result or error comes in the future."""
        if self._stopped:
            raise RuntimeError("this worker has been shut down")
        future: Future[T] = Future()
        self._calls.put((future, pickle.dumps((fn, args, kwargs))))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more calls. With `cancel_futures` the process is killed, also during a call."""
        self._stopped = True
        if cancel_futures:
            with self._starting:
                self._kill()
        self._calls.put(None)
        if wait:
            self._thread.join()

    # ---- the thread that controls the process ----

    def _run(self) -> None:
        while (item := self._calls.get()) is not None:
            future, call = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                result = self._call(call)
            except BaseException as error:
                future.set_exception(error)
            else:
                future.set_result(result)
        self._end()

    def _call(self, call: bytes) -> Any:
        process = self._ready()
        expired = threading.Event()
        timer = self._timer(process, expired)
        try:
            _send(process.stdin, call)
            succeeded, value = pickle.loads(_receive(process.stdout))
        except (OSError, EOFError):
            self._kill()
            raise self._reason(process.wait(), expired.is_set()) from None
        finally:
            timer.cancel()
        if succeeded:
            return value
        raise value

    def _timer(self, process: subprocess.Popen[bytes], expired: threading.Event) -> threading.Timer:
        def expire() -> None:
            expired.set()
            process.kill()

        timer = threading.Timer(min(self._limits.timeout_s or 0.0, threading.TIMEOUT_MAX), expire)
        timer.daemon = True
        if self._limits.timeout_s is not None:
            timer.start()
        return timer

    def _reason(self, status: int, expired: bool) -> WorkerFailed:
        if expired:
            return WorkerTimeout(f"no answer within {self._limits.timeout_s:g} s")
        return WorkerCrashed(f"the process that worked on it was lost ({_how(status)}){self._hint()}")

    def _hint(self) -> str:
        """A crash may be due to the memory limit: some libraries abort when an allocation fails."""
        limit = self._limits.memory_gb
        return "" if limit is None else f"; --memory {limit:g} may be too little"

    def _ready(self) -> subprocess.Popen[bytes]:
        """The process, ready for a call; started if there is none, which is tried three times."""
        if self._process is not None and self._process.poll() is None:
            return self._process
        for _ in range(3):
            process = self._start()
            with suppress(OSError, EOFError):
                _receive(process.stdout)
                return process
            self._kill()
        raise BrokenExecutor(f"a worker process ends before it is ready{self._hint()}")

    def _start(self) -> subprocess.Popen[bytes]:
        with self._starting:
            if self._stopped:
                raise BrokenExecutor("this worker has been shut down")
            self._end()
            self._process = _spawn(self._limits, self._inherit)
        return self._process

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()

    def _end(self) -> None:
        """End the process by closing its pipes, or kill it if it does not end in time."""
        if self._process is None:
            return
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                if stream is not None:
                    stream.close()
        try:
            self._process.wait(10.0)  # s, to end by itself
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _how(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    with suppress(ValueError):
        return signal.Signals(-status).name
    return f"signal {-status}"


def _spawn(limits: Limits, inherit: tuple[int, ...]) -> subprocess.Popen[bytes]:
    gb = limits.memory_gb
    memory = 0 if gb is None else max(1, int(min(gb * 1e9, 2**62)))  # setrlimit takes no more
    # the same import path as here; -P: without the current folder in front of it
    path = os.pathsep.join(place or os.getcwd() for place in sys.path)
    own_group: dict[str, Any] = {"start_new_session": True, "pass_fds": inherit}
    if os.name != "posix":
        own_group = {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
    try:
        return subprocess.Popen(
            [sys.executable, "-P", "-c", SERVE, str(memory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD, "PYTHONPATH": path},
            **own_group,
        )
    except OSError as error:
        raise BrokenExecutor(f"a worker process cannot be started: {error.strerror or error}") from error


# ---- in the child process ----


def serve(limit: int) -> None:
    """Main loop of the child process: answer calls from stdin until it is closed; `limit` of memory, bytes, or 0."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the replies
    if limit:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    _warm_up()
    calls: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, calls), daemon=True).start()
    _send(replies, b"ready")
    while True:
        _send(replies, _answer(calls.get()))


def _warm_up() -> None:
    """Import what every call needs, so that it does not count towards the time limit."""
    import cv2

    import slopecli.batch.answer  # noqa: F401

    cv2.setNumThreads(1)


def _listen(requests: IO[bytes], calls: queue.SimpleQueue[bytes]) -> None:
    """Put calls into the queue, and end the process at once when its parent has ended."""
    try:
        while True:
            calls.put(_receive(requests))
    except (OSError, EOFError):
        os._exit(0)


def _answer(call: bytes) -> bytes:
    try:
        function, args, kwargs = pickle.loads(call)
        return pickle.dumps((True, function(*args, **kwargs)))
    except BaseException as error:
        error.add_note("in the worker process:\n" + "".join(traceback.format_tb(error.__traceback__)))
        try:
            reply = pickle.dumps((False, error))
            pickle.loads(reply)
        except Exception:  # not every exception can be pickled, and not all that can be, unpickled
            return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))
        return reply


def _send(stream: IO[bytes] | None, message: bytes) -> None:
    if stream is None:
        raise EOFError
    stream.write(HEADER.pack(len(message)) + message)
    stream.flush()


def _receive(stream: IO[bytes] | None) -> bytes:
    """The next message; raises EOFError if the stream ends before its end."""
    header = b"" if stream is None else stream.read(HEADER.size)
    if stream is None or len(header) < HEADER.size:
        raise EOFError
    (length,) = HEADER.unpack(header)
    message = stream.read(length)
    if len(message) < length:
        raise EOFError
    return message
