"""One program at a time writes to a folder, and one that is gone stands in nobody's way."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from slopecli.errors import InputError
from slopecli.io import lock, locked

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and descriptors of POSIX")

HOLD = """
import sys, time
from pathlib import Path
from slopecli.io.lock import locked
with locked(Path(sys.argv[1])) as descriptor:
    {then}
    print("held", flush=True)
    time.sleep(600)
"""
CHILD = 'import subprocess; subprocess.Popen(["sleep", "2"], pass_fds=(descriptor,), stdout=subprocess.DEVNULL)'


def hold_elsewhere(folder: Path, then: str = "pass") -> subprocess.Popen[str]:
    program = HOLD.format(then=then)
    holder = subprocess.Popen([sys.executable, "-c", program, str(folder)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    return holder


def kill(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


def no_locks(*_: object) -> None:
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


@pytest.fixture(params=["locks", "none"])
def file_system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """With the locks of the file system, and as on one that has none."""
    if request.param == "none":
        monkeypatch.setattr("fcntl.flock", no_locks)
    return str(request.param)


def test_a_second_program_is_refused_and_told_who_holds_the_folder(tmp_path: Path) -> None:
    holder = hold_elsewhere(tmp_path)
    with (
        pytest.raises(InputError, match=f"in use by another batch .process {holder.pid} on .*-o") as refused,
        locked(tmp_path),
    ):
        pass
    assert "\n" not in str(refused.value)
    kill(holder)


def test_the_folder_is_free_again_and_empty_afterwards(tmp_path: Path, file_system: str) -> None:
    for _ in range(2):
        with locked(tmp_path), pytest.raises(InputError, match="in use"), locked(tmp_path):
            pass
    assert not list(tmp_path.iterdir())


def test_a_killed_holder_is_in_nobodys_way(tmp_path: Path) -> None:
    kill(hold_elsewhere(tmp_path))
    with locked(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_children_of_a_killed_holder_are_waited_for(tmp_path: Path) -> None:
    kill(hold_elsewhere(tmp_path, CHILD))
    assert not is_free(tmp_path)
    with locked(tmp_path):
        pass


def is_free(folder: Path) -> bool:
    descriptor = lock._try(folder)
    if descriptor is not None:
        os.close(descriptor)
    return descriptor is not None


def test_children_that_do_not_end_are_not_waited_for_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "WAIT_S", 0.2)
    kill(hold_elsewhere(tmp_path, CHILD))
    with pytest.raises(InputError, match="in use"), locked(tmp_path):
        pass


def mark_of_gone() -> str:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return f"{ended.pid} {socket.gethostname()}"


@pytest.mark.parametrize(("mark", "free"), [(mark_of_gone, True), (lambda: "1 another-machine", False)])
def test_without_locks_a_mark_counts_as_long_as_its_maker_may_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mark: Callable[[], str], free: bool
) -> None:
    monkeypatch.setattr("fcntl.flock", no_locks)
    (tmp_path / lock.MARK).write_text(mark())
    if free:
        with locked(tmp_path):
            pass
    else:
        with pytest.raises(InputError, match="another-machine"), locked(tmp_path):
            pass


def test_a_folder_that_cannot_be_written_to_is_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"), locked(tmp_path / "none"):
        pass


def test_a_link_in_place_of_the_lock_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".slopemap.lock").symlink_to(tmp_path / "mine.txt")
    with pytest.raises(OSError, match="link"), locked(tmp_path / "out"):
        pass
    assert (tmp_path / "mine.txt").read_text() == "mine"
