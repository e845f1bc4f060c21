"""Everything that is compared with other programs, in one run, into docs/benchmarks.md: `make bench`.

    OPENBLAS_NUM_THREADS=1 python benchmarks/compare.py [--only program,commands] [--into docs/benchmarks.md]

Accuracy of the solvers beside OpenCV, PoseLib and pycolmap (solvers.py), time of the solver (solver_speed.py), of the
whole program, stage by stage (whole_program.py), and of every command for a pair (command_times.py). Times are of the
processor, so other work on the machine matters little.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path

import command_times
import solver_speed
import solvers
import whole_program
from documents import write_between

PACKAGES = ("numpy", "opencv-contrib-python-headless", "poselib", "pycolmap")


def machine() -> str:
    """What the numbers were measured on, and with."""
    lines = [
        f"processor   {_processor()}, {os.cpu_count()} cores",
        f"system      {platform.system()} {platform.machine()}, Python {platform.python_version()}",
        f"seeds       {solvers.SEED} (scenes), 0 (slopemap estimate)",
    ]
    return "\n".join([*lines, *(f"{name:32}{_version(name)}" for name in PACKAGES)])


def _processor() -> str:
    """The name the processor gives itself, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


# a process counts as its own what its parent held when it was started: the whole program comes before the peers
SECTIONS: dict[str, Callable[[], str]] = {
    "machine": machine,
    "program": whole_program.report,
    "commands": command_times.report,
    "time": solver_speed.report,
    "solvers": solvers.report,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, metavar="FILE")
    parser.add_argument("--only", default=",".join(SECTIONS), metavar="SECTION,..", help="%(default)s")
    arguments = parser.parse_args()
    document, wanted = arguments.into, arguments.only.split(",")
    if unknown := set(wanted) - set(SECTIONS):
        parser.error(f"no section {', '.join(sorted(unknown))}; there are {', '.join(SECTIONS)}")
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
        print("set OPENBLAS_NUM_THREADS=1, as the program does: more threads only wait for each other", file=sys.stderr)
    for name in (name for name in SECTIONS if name in wanted):
        text = SECTIONS[name]()
        print(f"== {name}\n{text}\n", flush=True)
        if document:
            write_between(document, name, f"```text\n{text}\n```")


if __name__ == "__main__":
    main()
