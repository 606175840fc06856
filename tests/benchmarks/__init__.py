"""How fast Quietfix is beside its peers: ``make bench``, or ``python -m tests.benchmarks``.

A comparison is one file and one line in `registry`. All of them run on one BLAS thread: the matrices are small, and
a second thread would measure how idle the machine is. NumPy reads these variables once, when it is imported.
"""

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
