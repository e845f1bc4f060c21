"""Folders that one program at a time may write to."""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from slopecli.errors import InputError

LOCK = ".slopemap.lock"
MARK = ".slopemap.held"
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EINVAL)  # what file systems without locks answer
PATIENCE_S = 30.0  # for workers of a killed program to notice that they are alone
PAUSE_S = 0.05


@contextmanager
def locked(folder: Path) -> Iterator[int]:
    """Hold a folder; gives the descriptor of the lock, for child processes that shall hold it too.

    The lock lasts until all of them have ended, however they end. Where the file system has no locks, a file stands
    for it; a killed program leaves that behind, and it counts no longer once no process of its number is found.

    Raises
    ------
    InputError : another program holds it.
    OSError : the folder cannot be written to.
    """
    descriptor = _take(folder)
    try:
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"{os.getpid()} {socket.gethostname()}".encode())
        yield descriptor
    finally:
        for name in (MARK, LOCK):
            with suppress(OSError):
                os.unlink(folder / name)  # while the lock is held, so that nobody can have taken the new one
        os.close(descriptor)


def _take(folder: Path) -> int:
    """Descriptor of the lock. Waits for the workers of a program that is gone, but not for one that runs."""
    deadline = time.monotonic() + PATIENCE_S
    while (descriptor := _try(folder)) is None:
        holder = _holder(folder / MARK) or _holder(folder / LOCK)
        if _runs(holder) or time.monotonic() > deadline:
            process, _, host = holder.partition(" ")
            who = f"process {process} on {host}" if host else "its holder did not leave a name"
            raise InputError(
                f"{folder} is in use by another batch ({who}); wait for its end, or choose another folder with -o"
            )
        time.sleep(PAUSE_S)
    return descriptor


def _holder(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace")
    except OSError:
        return ""


def _runs(holder: str) -> bool:
    """Whether the process of a holder ("PID HOST") runs; of other machines that cannot be told, and it may."""
    process, _, host = holder.partition(" ")
    if not process.isdigit():
        return False  # it has not signed yet
    if host != socket.gethostname() or os.name != "posix":
        return True
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True


def _try(folder: Path) -> int | None:
    """Descriptor of the lock if it was free."""
    path = folder / LOCK
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    taken = False
    try:
        taken = _lock(descriptor) and _is_still(descriptor, path)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        return _try_mark(folder / MARK)
    finally:
        if not taken:
            os.close(descriptor)
    return descriptor if taken else None


def _lock(descriptor: int) -> bool:
    """Take the lock of an open file if it is free."""
    try:
        import fcntl
    except ImportError:
        return _lock_byte(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _lock_byte(descriptor: int) -> bool:
    """The same on Windows, by a byte far behind the holder's name, which stays readable."""
    import msvcrt

    os.lseek(descriptor, 1 << 20, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError:
        return False
    finally:
        os.lseek(descriptor, 0, os.SEEK_SET)
    return True


def _is_still(descriptor: int, path: Path) -> bool:
    """Whether the file that was locked still has its name: its last holder took that away."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _try_mark(path: Path) -> int | None:
    """Without locks: descriptor of a file that only one program can make; one that is left over is removed."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        holder = _holder(path)
        if holder and not _runs(holder):
            path.unlink(missing_ok=True)
        return None
