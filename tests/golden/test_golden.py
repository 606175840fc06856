"""A move of code changes no number: every packaged scenario against the golden record."""

import os

import numpy as np
import pytest

from tests.golden.cases import CASES
from tests.golden.record import fingerprint, machine, read

RECORD = read()
SAME = RECORD["machine"] == machine()
RECORDED = ("beacon_rocket:falcon9", "satellite_ranging:jason2")


def decides(name, array, arrays):
    """Whether a cloud's choices are in an array: one that rounding turns the other way changes whole numbers."""
    clouds = any(other.startswith("ancestors_") for other in arrays)
    return clouds and ("estimator" in array["dims"] or name.endswith(("_pf", "_pf_sir")))


def test_every_case_is_recorded():
    assert list(RECORD["cases"]) == list(CASES)
    assert len({case["arrays"]["estimate"]["hash"] for case in RECORD["cases"].values()}) == len(CASES)


@pytest.mark.parametrize("title", CASES)
def test_as_recorded(title):
    if title in RECORDED and not os.path.isdir(os.environ.get("QUIETFIX_DATA", "")):
        pytest.skip("its truth is recorded data, which QUIETFIX_DATA names")
    now, then = fingerprint(title), RECORD["cases"][title]
    for part in ("blocks", "attributes", "names", "time_s"):
        assert now[part] == then[part], part
    assert list(now["arrays"]) == list(then["arrays"])
    different = []
    for name, array in now["arrays"].items():
        before = then["arrays"][name]
        assert [array[k] for k in ("dims", "shape", "missing")] == [before[k] for k in ("dims", "shape", "missing")]
        if array["hash"] != before["hash"]:
            different.append(name)
            if not SAME and decides(name, array, now["arrays"]):
                continue
            # Another processor or NumPy rounds otherwise. Four trials and a few epochs let that grow to some 1e-9
            # of the largest element; a changed formula, key or order of trials is seen in the third digit.
            np.testing.assert_allclose(array["sums"], before["sums"], rtol=1e-6, atol=1e-6 * before["sums"][0])
    assert not SAME or not different, f"the last bits have changed: {', '.join(different)}"
