"""The six rows against differences in time along an integrated arc; subsets; angles; occultation."""

import numpy as np
import pytest

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics, rows_of, sight_axes
from quietfix.systems.geometry.visibility import EarthOccultation
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.trajectories.gravity import acceleration
from tests.systems.ranging_scene import EARTH, SIGMAS, TIMES, arc, sensor


@pytest.mark.parametrize("j2", [False, True])
def test_rates_are_the_time_derivatives(j2):
    """Rates by a four-point difference of the angles and ranges at 2 s, error h^4/30 of the fifth derivative."""
    h, model = 2.0, sensor(j2)
    times = TIMES[1:-1]

    def rows(shift):
        observer, target = arc(j2, times=times + shift)
        return model.predict(target, observer[:, None]), np.linalg.norm((target - observer)[:, :3], axis=-1)

    (far, r2), (near, r1), (back, q1), (rear, q2) = (rows(s * h) for s in (2, 1, -1, -2))
    (exact, r0) = rows(0.0)

    def rate(a, b, c, d):
        return (-a + 8 * b - 8 * c + d) / (12 * h)

    angles = [np.unwrap([rear[:, i], back[:, i], near[:, i], far[:, i]], axis=0) for i in (0, 1)]
    for i, angle in enumerate(angles):
        slope = rate(angle[3], angle[2], angle[1], angle[0])
        np.testing.assert_allclose(exact[:, 2 + i], slope, rtol=0, atol=1e-9 * np.abs(exact[:, 2 + i]).max() + 1e-12)
    np.testing.assert_allclose(exact[:, 4], rate(r2, r1, q1, q2), rtol=0, atol=1e-5)
    second = (-r2 + 16 * r1 - 30 * r0 + 16 * q1 - q2) / (12 * h * h)
    np.testing.assert_allclose(exact[:, 5], second, rtol=0, atol=2e-6)  # m/s^2; rounding of r is 1e-8 m / h^2


def test_printed_component_equations():
    """(8): the sign of its e_epsilon and e_beta parts; numbers at 1000 s from the reference."""
    observer, target = (states[100] for states in arc())
    h = 1.0
    near, here, back = (
        sensor().predict(t, o[:, None]) for o, t in (arc(times=np.array([1000.0 + s])) for s in (h, 0.0, -h))
    )
    beta_acceleration, epsilon_acceleration = ((near - back)[0, 2:4]) / (2 * h)
    beta, epsilon, turn, lift, speed, _ = here[0]
    r = np.linalg.norm((target - observer)[:3])
    relative = acceleration(target[:3], EARTH, False) - acceleration(observer[:3], EARTH, False)
    axes = sight_axes(np.array(beta), np.array(epsilon))
    bend = r * turn**2 * np.cos(epsilon) * np.sin(epsilon)
    up = r * epsilon_acceleration + 2 * speed * lift
    assert relative @ axes.elevational == pytest.approx(up + bend, abs=1e-4)
    assert relative @ axes.elevational == pytest.approx(-5.854882, abs=1e-5)
    assert up - bend == pytest.approx(-0.235, abs=2e-3)  # as printed
    side = r * beta_acceleration * np.cos(epsilon) + 2 * speed * turn * np.cos(epsilon)
    drag = 2 * r * turn * lift * np.sin(epsilon)
    assert relative @ axes.azimuthal == pytest.approx(side - drag, abs=1e-4)
    assert relative @ axes.azimuthal == pytest.approx(2.771990, abs=1e-5)
    assert side + drag == pytest.approx(8.0757, abs=2e-3)  # as printed


def test_rows_are_picked_by_name_and_stack():
    observer, target = arc(times=TIMES[::100])
    platforms = observer[:, None]
    whole = sensor()
    assert whole.names == tuple(ROWS)
    picked = RelativeKinematics({"radial_velocity": 10.0, "azimuth": 1e-3}, EARTH)
    assert picked.names == ("azimuth", "radial_velocity") and picked.units == ("rad", "m/s")
    np.testing.assert_array_equal(picked.predict(target, platforms), whole.predict(target, platforms)[:, [0, 4]])
    assert rows_of(["rates", "angles"]) == list(ROWS)[:4] and rows_of(["radial_velocity"]) == ["radial_velocity"]
    halves = Stack(
        [
            RelativeKinematics({row: SIGMAS[i] for i, row in enumerate(ROWS) if (i < 2) == first}, EARTH)
            for first in (True, False)
        ]
    )
    for one, other in zip(halves.linearize(target, platforms), whole.linearize(target, platforms), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)


def test_angles_are_wrapped():
    model = sensor()
    measured, predicted = np.zeros((1, 6)), np.zeros((1, 6))
    measured[0, 0], predicted[0, 0] = np.pi - 0.01, -np.pi + 0.02
    assert model.residual(measured, predicted)[0, 0] == pytest.approx(-0.03, abs=1e-12)
    assert model.represent(np.array([[3.2, 0, 0, 0, 0, 0]]))[0, 0] == pytest.approx(3.2 - 2 * np.pi)
    rate_only = RelativeKinematics({"azimuth_rate": 1e-5}, EARTH)
    assert rate_only.residual(np.array([[4.0]]), np.array([[0.0]]))[0, 0] == 4.0


def test_an_unknown_row_and_a_sigma_of_zero_are_refused():
    with pytest.raises(ValueError, match=r"rows: \['range'\] is not allowed"):
        RelativeKinematics({"range": 1.0})
    with pytest.raises(ValueError, match=r"sigma_azimuth: 0\.0 is not allowed"):
        RelativeKinematics({"azimuth": 0.0})


def test_the_earth_blocks_the_papers_line_of_sight_from_1860_s():
    observer, target = arc()
    seen = EarthOccultation(EARTH.radius).visible(target, observer[:, None])[:, 0]
    assert seen[:186].all() and not seen[186:].any()
    assert np.count_nonzero(~seen) / seen.size == pytest.approx(0.63, abs=0.005)


def test_occultation_by_a_sphere():
    mask = EarthOccultation(1.0)
    platform = np.array([[2.0, 0, 0, 0, 0, 0]])
    cases = {(-2.0, 0, 0): False, (-2.0, 2.4, 0): True, (1.2, 0, 0): True, (3.0, 0, 0): True, (-3.0, 0.1, 1): False}
    for place, expected in cases.items():
        assert mask.visible(np.array([*place, 0, 0, 0], dtype=float), platform)[0] == expected
    with pytest.raises(ValueError, match="occultation radius"):
        EarthOccultation(0.0)
