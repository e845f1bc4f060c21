"""A lock on a folder, so that one program at a time writes to it."""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from slopecli.errors import InputError
from slopecli.io.files import read_file

LOCK = ".slopemap.lock"
MARK = ".slopemap.held"
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EINVAL)  # errors of file systems without locks
WAIT_S = 30.0  # time for the workers of a killed program to end


@contextmanager
def locked(folder: Path) -> Iterator[int]:
    """Lock a folder; gives the file descriptor of the lock, which child processes may inherit.

    The lock lasts until all processes that hold the descriptor have ended. On a file system without locks, a marker
    file is used instead; it is ignored when the process that made it no longer runs.

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
                os.unlink(folder / name)  # before the lock is released, so that no other program has locked it
        os.close(descriptor)


def _take(folder: Path) -> int:
    """Descriptor of the lock. Waits for the workers of a program that has ended, but not for a running program."""
    deadline = time.monotonic() + WAIT_S
    while (descriptor := _try(folder)) is None:
        holder = _holder(folder / MARK) or _holder(folder / LOCK)
        if _runs(holder) or time.monotonic() > deadline:
            process, _, host = holder.partition(" ")
            who = f"process {process} on {host}" if host else "its holder did not leave a name"
            raise InputError(
                f"{folder} is in use by another batch ({who}); wait for its end, or choose another folder with -o"
            )
        time.sleep(0.05)
    return descriptor


def _holder(path: Path) -> str:
    try:
        return read_file(path, "lock", 1000).decode("utf-8", errors="replace")
    except InputError:
        return ""


def _runs(holder: str) -> bool:
    """Whether the process of a holder ("PID HOST") runs; assumed if it is on another machine."""
    process, _, host = holder.partition(" ")
    if not process.isdigit():
        return False  # it has not written its number yet
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
    """Descriptor of the lock, None if another program holds it."""
    path = folder / LOCK
    # a link is not followed: what it leads to would be emptied
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
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
    """Lock an open file; False if it is locked."""
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
    """As `_lock`, on Windows: locks a byte far behind the holder's name, which stays readable."""
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
    """Whether the locked file still has its name; the last holder may have deleted it."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _try_mark(path: Path) -> int | None:
    """Without locks: descriptor of a marker file that is created exclusively; an abandoned one is removed."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        holder = _holder(path)
        if holder and not _runs(holder):
            path.unlink(missing_ok=True)
        return None
