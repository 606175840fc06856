"""The largest resident memory of this process, for the tests and benchmarks that ask how much a run takes."""

import resource
import sys
from pathlib import Path


def peak_bytes() -> int:
    """Return the largest resident memory that this process has had [bytes].

    Linux carries ``ru_maxrss`` of the parent over into a child, so the kernel's own mark of this process is read
    where there is one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        marks = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM:")]
        if marks:
            return int(marks[0]) * 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
