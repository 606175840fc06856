"""Write the golden record anew: ``python -m tests.golden [TITLE...]``; the commit says which numbers change and why."""

import sys

from tests.golden.cases import CASES
from tests.golden.record import FILE, fingerprint, machine, read, write

wanted = sys.argv[1:] or list(CASES)
before = read() if FILE.exists() else {"machine": machine(), "cases": {}}
if before["machine"] != machine() and set(wanted) != set(CASES):
    sys.exit("the record is of another machine: write all of it")
cases = dict(before["cases"])
for title in wanted:
    now = fingerprint(title)
    old = cases.get(title)
    changed = [] if old is None else [n for n, a in now["arrays"].items() if old["arrays"].get(n) != a]
    print(title, "new" if old is None else f"changed: {', '.join(changed)}" if changed else "as it was", flush=True)
    cases[title] = now
    write({key: cases[key] for key in CASES if key in cases})
