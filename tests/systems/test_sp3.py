"""SP3 files: units, time scale, mistakes; and the orbit plant against Jason-2's precise orbit."""

import numpy as np
import pytest

from systems.motion.orbital import OrbitalMotion
from systems.plants.orbit import DenseOrbit
from systems.plants.sp3 import read_sp3
from tests.systems.ranging_scene import EARTH

HEAD = """#cV2008  8 30 21  0  0.00000000       {count} DORIS ITR05 FIT  LCA
## 1494 594000.00000000    60.00000000 54708 0.8750000000000
+    1   L27  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++         0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
%c L  cc TAI ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
%f  0.0000000  0.000000000  0.00000000000  0.000000000000000
/* a comment
"""


def text(epochs=4, factor=10.0, count=None, minutes=None, end=True):
    """A file of a body that moves at 1 km/s in y; `factor` is what a m/s counts as in the file."""
    lines = [HEAD.format(count=epochs if count is None else count).rstrip("\n")]
    for minute in minutes or range(epochs):
        lines.append(f"*  2008  8 30 21 {minute:2d}  0.00000000")
        position = (7000.0, 60.0 * minute, -1234.567890)
        lines.append("PL27" + "".join(f"{value:14.6f}" for value in position) + " 999999.999999")
        lines.append("VL27" + "".join(f"{value:14.6f}" for value in (0.0, 1e3 * factor, 0.0)) + " 999999.999999")
    return "\n".join([*lines, "EOF"] if end else lines) + "\n"


def write(tmp_path, content):
    path = tmp_path / "orbit.sp3"
    path.write_text(content)
    return path


@pytest.mark.parametrize(("factor", "unit"), [(10.0, "dm/s"), (1.0, "m/s"), (1e-3, "km/s")])
def test_the_unit_of_the_velocities_is_found_from_the_positions(tmp_path, factor, unit):
    orbit = read_sp3(write(tmp_path, text(factor=factor)))
    assert (orbit.velocity_unit, orbit.time_system, orbit.coordinate_system) == (unit, "TAI", "ITR05")
    assert orbit.satellite == "L27" and str(orbit.first_epoch) == "2008-08-30 21:00:00"
    np.testing.assert_array_equal(orbit.times, [0, 60, 120, 180])
    np.testing.assert_allclose(orbit.states[1], [7e6, 60e3, -1234567.89, 0, 1e3, 0], rtol=1e-12)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (text(end=False), "ends in the middle: 4 of 4 epochs, and no EOF line"),
        (text(count=9), "ends in the middle: 4 of 9 epochs"),
        (text()[: text().index("VL27")] + "VL27   12", "line 10 cannot be read"),
        (text(minutes=[0, 1, 1, 2]), "epoch 3, 2008-08-30 21:01:00, does not come after"),
        (text(factor=3.0), "velocities and positions do not fit"),
        ("hello\n", "not an SP3 file"),
        ("", "not an SP3 file"),
        (text().replace("       4 DORIS", "    four DORIS"), "number of epochs cannot be read"),
    ],
)
def test_files_that_are_wrong(tmp_path, content, words):
    with pytest.raises(ValueError, match=words):
        read_sp3(write(tmp_path, content))


def test_an_unknown_satellite(tmp_path):
    with pytest.raises(ValueError, match="satellite L99 is not in it; there are L27"):
        read_sp3(write(tmp_path, text()), "L99")


def test_a_gap_is_nan(tmp_path):
    absent = "PL27" + 3 * f"{0.0:14.6f}" + " 999999.999999"
    lines = text().splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith("PL27")][1]
    lines[at] = absent
    states = read_sp3(write(tmp_path, "\n".join(lines))).states
    assert np.isnan(states[1, :3]).all() and np.isfinite(states[[0, 2, 3]]).all()


def test_the_start_must_leave_something(tmp_path):
    orbit = read_sp3(write(tmp_path, text()))
    times, states = orbit.inertial(60.0)
    np.testing.assert_array_equal(times, [0, 60, 120])
    np.testing.assert_allclose(states[0, :3], orbit.states[1, :3])  # the axes coincide at the start
    with pytest.raises(ValueError, match="170 s is not allowed; the record is 180 s long"):
        orbit.inertial(170.0)


def test_jason_2_for_one_revolution(recorded):
    """Two bodies and J2: at most 0.6 km off after one revolution from the first epoch; two bodies alone: 61 km.

    What two bodies miss depends on where in the revolution the osculating orbit is taken: 16 to 95 km over ten
    revolutions (the reference has 21 km for its start), with J2 33 m to 1.3 km, median 0.39 km.
    """
    orbit = read_sp3(next(recorded("sp3").glob("grgja2*.sp3")))
    assert (orbit.satellite, orbit.velocity_unit, orbit.time_system) == ("L27", "m/s", "TAI")
    assert orbit.times.size == 5406 and np.isfinite(orbit.states).all()
    times, states = orbit.inertial()
    radius = np.linalg.norm(states[:, :3], axis=-1)
    assert np.all(np.abs(radius - 7.714e6) < 30e3)
    for j2, limit in ((True, 600.0), (False, 61e3)):
        plant = DenseOrbit(states[:1], times[112], EARTH, j2)
        off = np.linalg.norm((plant.at(times[112])[0] - states[112])[:3])
        assert limit / 2 < off < limit
    starts, off = np.arange(0, 1120, 16), {}
    for j2 in (True, False):
        motion, state = OrbitalMotion(EARTH, j2), states[starts]
        for _ in range(112):  # minutes; a revolution takes 112.4
            state = motion.propagate(state, 60.0)
        off[j2] = np.linalg.norm((state - states[starts + 112])[:, :3], axis=-1)
    assert off[True][0] < 600.0 and np.median(off[True]) < 600.0
    assert off[False][0] == pytest.approx(60.7e3, rel=0.01)
    assert off[False].min() > 15e3 and np.median(off[False] / off[True]) > 50
