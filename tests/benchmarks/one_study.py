"""One study in a process of its own; prints what it took as one line of JSON.

``python -m tests.benchmarks.one_study TRIALS SECONDS [chunks] [SYSTEM]``; 0 trials only imports. With ``chunks`` every
chunk is forgotten before the next one runs, as on the command line, which writes it to the disk.
"""

from __future__ import annotations

import json
import sys
import time

from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import run_study
from tests.peak_memory import peak_bytes


def main() -> None:
    """Run and report."""
    trials, duration = int(sys.argv[1]), float(sys.argv[2])
    system, options = "three_satellite", {"trials": trials, "set": [f"duration_s={duration}"]}
    if "beacon_rocket" in sys.argv[3:]:
        system = "beacon_rocket"
        options |= {"set": [f"stop_s={50.0 + duration}"], "estimators": ["ukf"]}
    report = {"seconds": 0.0, "trials": 0, "estimators": 0, "steps": 0}
    if trials:
        begun = time.process_time()
        for part in Study(system, **options).chunks() if "chunks" in sys.argv[3:] else [run_study(system, **options)]:
            report["trials"] += part.sizes["trial"]
            report["estimators"] = part.sizes["estimator"]
            report["steps"] = part.sizes["time"] - 1
            del part
        report["seconds"] = time.process_time() - begun
    report["megabytes"] = peak_bytes() / 1e6
    print(json.dumps(report))


if __name__ == "__main__":
    main()
