"""`python -m fuzzing`: the campaign, or one failure again."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from fuzzing.blocks import DRAWN
from fuzzing.case import read_case
from fuzzing.checks import complaints, gist, limit_memory, run_command
from fuzzing.kinds import KINDS
from fuzzing.pool import Pool

BLOCK = 25  # cases
MOST_ALIKE = 3  # failures that are kept of those of one cause
FAILURES = Path("fuzz_failures")


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzzing", description=__doc__)
    parser.add_argument("-n", type=int, default=10_000, metavar="N", help="inputs (10000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random numbers (0)")
    parser.add_argument(
        "--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes (one a core)"
    )
    parser.add_argument("--only", action="append", choices=[*KINDS, DRAWN], help="this kind; may be given again")
    parser.add_argument("--stop", type=int, default=50, metavar="N", help="end after this many different failures (50)")
    parser.add_argument("--repeat", type=Path, metavar="FOLDER", help="run the failure in this folder again")
    chosen = parser.parse_args()
    return repeat(chosen.repeat) if chosen.repeat else campaign(chosen)


def campaign(chosen: argparse.Namespace) -> int:
    start, found = time.monotonic(), 0
    pool = Pool(chosen.seed, chosen.jobs, chosen.only)
    alike: Counter[str] = Counter()
    for failure in pool.failures(iter(range(-(-chosen.n // BLOCK))), BLOCK):
        found += 1
        alike[gist(failure.complaints)] += 1
        if alike[gist(failure.complaints)] > MOST_ALIKE:
            continue
        folder = FAILURES / f"{failure.case.kind.replace(' ', '-')}-{chosen.seed}-{failure.number}-{found}"
        failure.case.keep(folder, failure.complaints)
        print(f"FAILED: slopemap {' '.join(map(ascii, failure.case.arguments))}")
        print("  " + "\n  ".join(ascii(line)[1:-1][-700:] for line in failure.complaints))
        print(f"  again: PYTHONPATH=tests {Path(sys.executable).name} -m fuzzing --repeat {folder}", flush=True)
        if len(alike) >= chosen.stop:
            break
    for what, times in alike.most_common():
        print(f"{times:6d} times {what}")
    kinds = ", ".join(f"{count} {kind} in {s:.0f} s" for kind, (count, s) in sorted(pool.tally.items()))
    print(f"{pool.done} inputs ({kinds}), seed {chosen.seed}: {found} failures, {time.monotonic() - start:.0f} s")
    return min(found, 1)


def repeat(folder: Path) -> int:
    """Run a failure again, as the campaign does and with the traceback."""
    case = read_case(folder)
    limit_memory()
    with tempfile.TemporaryDirectory() as place:
        found = complaints(case, Path(place, "case"))
        case.lay_out(Path(place, "case"))
        done = run_command([*case.arguments, *(["-v"] if "-q" not in case.arguments else [])], Path(place, "case"))
    print(f"slopemap {' '.join(map(ascii, case.arguments))}: exit status {done.returncode}")
    print(done.stderr.encode("ascii", "backslashreplace").decode())
    print("\n".join(map(ascii, found)) or "nothing is wrong")
    return min(len(found), 1)


if __name__ == "__main__":
    sys.exit(main())
