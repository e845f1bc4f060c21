"""Reading input files: pipes, devices, folders and files without an end are read or refused, and none is waited for."""

from __future__ import annotations

import os
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from command import slopemap

from slopecli.errors import InputError
from slopecli.io import files, load_image, load_pose, read_correspondences, read_file

POSIX = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX only")
ROWS = b"x1,y1,x2,y2\n1,2,3,4\n"


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "fifo")
    return tmp_path / "fifo"


@POSIX
@pytest.mark.parametrize("read", [load_image, load_pose])
def test_a_pipe_where_a_file_is_needed(fifo: Path, read: object) -> None:
    with pytest.raises(InputError, match="not a regular file"):
        read(fifo)  # type: ignore[operator]


@POSIX
def test_a_pipe_to_which_nothing_is_written(fifo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "PIPE_WAIT_S", 0.05)
    with pytest.raises(InputError, match="a pipe to which nothing is written"):
        read_correspondences(fifo)


@POSIX
def test_a_pipe_that_is_written_to_slowly(fifo: Path) -> None:
    def write() -> None:
        with open(fifo, "wb") as file:
            for part in (ROWS[:5], ROWS[5:]):
                time.sleep(0.05)
                file.write(part)
                file.flush()

    writer = threading.Thread(target=write)
    writer.start()
    assert read_file(fifo, "list", 1000, pipe=True) == ROWS
    writer.join()


@POSIX
def test_a_pipe_of_the_shell_may_take_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "PIPE_WAIT_S", 0.01)
    reading, writing = os.pipe()
    later = threading.Timer(0.2, lambda: (os.write(writing, ROWS), os.close(writing)))
    later.start()
    assert read_file(f"/dev/fd/{reading}", "list", 1000, pipe=True) == ROWS
    later.join()
    os.close(reading)


@POSIX
def test_a_pipe_without_an_end_is_cut_off(fifo: Path) -> None:
    def write() -> None:
        with suppress(BrokenPipeError), open(fifo, "wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))

    writer = threading.Thread(target=write)
    writer.start()
    assert len(read_file(fifo, "list", 100_000, pipe=True)) == 100_001
    writer.join()


@pytest.mark.skipif(not os.path.exists("/proc/self/environ"), reason="Linux only")
def test_files_of_the_system_that_say_they_are_empty() -> None:
    assert read_file("/proc/self/status", "list", 1_000_000)
    with pytest.raises(InputError, match="too large for a list"):
        read_file("/proc/self/status", "list", 10)


@POSIX
def test_sockets_devices_and_folders(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(tmp_path / "socket"))
        for path in (tmp_path / "socket", "/dev/zero", "/dev/null"):
            with pytest.raises(InputError, match="not a regular file"):
                load_image(path)
    with pytest.raises(InputError, match="is a folder"):
        read_correspondences(tmp_path)


def test_names_that_no_file_can_have(tmp_path: Path) -> None:
    for name in ("a\0b", "x" * 5000, "\udcff"):
        with pytest.raises(InputError):
            read_file(name, "list", 10, tmp_path)


@POSIX
def test_the_command_refuses_an_input_named_like_an_output(tmp_path: Path) -> None:
    (tmp_path / "overlay.png").write_bytes(b"mine")
    for arguments in (
        ("estimate", "overlay.png", "b.png", "--fov", "60"),
        ("segment", "b.png", "overlay.png", "--fov", "60"),
        ("estimate", "a.png", "b.png", "--camera", "overlay.png"),
        ("solve", "overlay.png"),
        ("solve", "matches.csv", "--pose", "overlay.png"),
    ):
        done = slopemap(*arguments, "-o", ".", cwd=tmp_path)
        assert done.returncode == 1
        assert "overlay.png is an input" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["overlay.png"]
