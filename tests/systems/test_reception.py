"""Reception: exact delays, the same TDOA and FDOA as the measurement models, signs and time tags."""

import numpy as np
import pytest

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.frames import earth_fixed_to_inertial
from quietfix.systems.iq.modulation import Qpsk
from quietfix.systems.iq.reception import (
    Trajectory,
    delay_over,
    propagation_delay,
    receive,
    straight,
    with_acceleration,
)
from quietfix.systems.iq.waveform import Emission
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.trajectories.gravity import acceleration
from tests.systems.dual_scene import CARRIER, CONSTANTS, TARGET, orbit, scene

HALF = 0.0085


def _delays(here, gravity=True):
    pull = acceleration(here.platforms[:, :3], CONSTANTS) if gravity else 0.0
    return delay_over(straight(here.target), with_acceleration(here.platforms, pull), HALF)


def _difference(delay):
    """Return TDOA and FDOA of the wave front that reaches receiver 0 at time 0."""
    now = np.zeros(1)
    sent = -delay.at(now)[0, 0]
    heard = 0.0
    for _ in range(6):
        heard = sent + delay.at(np.array([heard]))[1, 0]
    rates = delay.rate(np.array([0.0, heard]))
    return heard, -CARRIER * (rates[1, 1] - rates[0, 0])


def test_delay_is_that_of_the_orbit_and_the_light():
    """Against the integrated orbit with J2 and the target on its Earth-fixed line, over the whole block."""
    time, satellites = 10.0, orbit()
    delay = _delays(scene(time))
    for t in np.linspace(-HALF, HALF, 7):
        place = satellites.at(time + t)[:, :3]
        exact = np.zeros(2)
        for _ in range(8):
            sent = time + t - exact
            moved = np.concatenate([TARGET[:3] + sent[:, None] * TARGET[3:], np.tile(TARGET[3:], (2, 1))], axis=-1)
            emitter = earth_fixed_to_inertial(moved, sent, CONSTANTS.earth_rate)[:, :3]
            exact = np.linalg.norm(place - emitter, axis=-1) / SPEED_OF_LIGHT
        # 1e-17 s is 3e-8 of a wavelength; the change of gravity leaves 1e-9 m = 3e-18 s; positions of 7e6 m are
        # rounded to 1e-9 m
        np.testing.assert_allclose(delay.at(np.array([t]))[:, 0], exact, atol=3e-17, rtol=0)


def test_the_polynomial_is_exact_and_so_is_its_derivative():
    here = scene()
    target, platforms = straight(here.target), with_acceleration(here.platforms, -8.0)
    delay = delay_over(target, platforms, 0.05)
    t = np.linspace(-0.05, 0.05, 101)
    np.testing.assert_allclose(
        delay.at(t), propagation_delay(target, platforms, np.broadcast_to(t, (2, 101))), atol=3e-17, rtol=0
    )
    step = 1e-4
    numeric = (delay.at(t + step) - delay.at(t - step)) / (2 * step)
    np.testing.assert_allclose(delay.rate(t), numeric, atol=1e-12, rtol=0)


def test_tdoa_and_fdoa_are_those_of_the_measurement_models():
    here = scene()
    exact = [
        model.predict(here.target, here.platforms)[0]
        for model in (
            Tdoa(1e-9, receivers=(1,), light_time=True),
            Fdoa(1.0, CARRIER, receivers=(1,), light_time=True),
        )
    ]
    # the models' motion is that of these trajectories; 1e-5 Hz is the polynomial's derivative
    tdoa, fdoa = _difference(_delays(here))
    assert tdoa == pytest.approx(exact[0], abs=1e-17)
    assert fdoa == pytest.approx(exact[1], abs=1e-5)
    # and what gravity does between the two arrivals, 0.2 ms apart: a tenth of the smallest sigma of a CAF
    tdoa, fdoa = _difference(_delays(here, gravity=False))
    assert tdoa == pytest.approx(exact[0], abs=1e-12)
    assert 1e-3 < abs(fdoa - exact[1]) < 0.02


def test_samples_hold_for_the_middle_of_the_block_and_signs_are_the_models():
    """Undoing TDOA and FDOA of mid block makes the two receptions equal; with a wrong sign or tag nothing is left."""
    here = scene()
    delay = _delays(here)
    tdoa, fdoa = _difference(delay)
    emission = Emission(Qpsk(), CARRIER, seed=3)
    offsets = (np.arange(8192) - 4095.5) / 4e6

    def coherence(shift, frequency):
        main = receive(emission, delay, here.time, offsets)[0]
        auxiliary = receive(emission, delay, here.time, offsets + shift)[1]
        product = auxiliary * main.conj() * np.exp(-2j * np.pi * frequency * offsets)
        return abs(product.mean()) / np.sqrt((abs(main) ** 2).mean() * (abs(auxiliary) ** 2).mean())

    # companding over +-1 ms: 1e-6 * 1 ms = 1 ns of delay, 0.05 rad of phase curvature
    assert coherence(tdoa, fdoa) > 0.9999
    assert coherence(-tdoa, fdoa) < 0.1
    assert coherence(tdoa, -fdoa) < 0.1
    # tagged at the start of the block the TDOA is off by 1 ns, invisible here; one sample more is not
    assert coherence(tdoa + 0.25e-6, fdoa) < 0.9


def test_reception_compresses_time():
    """A receiver that flies away at v hears the symbols at a rate lower by v/c."""
    away = Trajectory(np.array([[1e5, 0.0, 0.0]]), np.array([[7e3, 0.0, 0.0]]), np.zeros((1, 3)))
    still = Trajectory(np.zeros(3), np.zeros(3), np.zeros(3))
    delay = delay_over(still, away, 0.02)
    t = np.linspace(-0.02, 0.02, 5)
    np.testing.assert_allclose(delay.at(t)[0], (1e5 + 7e3 * t) / SPEED_OF_LIGHT, atol=1e-17, rtol=0)
    emission = Emission(Qpsk(), CARRIER)
    heard = receive(emission, delay, 0.0, t)[0]
    late = (1e5 + 7e3 * t) / SPEED_OF_LIGHT
    expected = emission.envelope(t - late) * np.exp(-2j * np.pi * np.remainder(CARRIER * late, 1))
    # 1e6 cycles in double precision leave 1e-10 of a cycle; symbols are known to 1e-11 of their period
    np.testing.assert_allclose(heard, expected, atol=1e-7)


def test_trials_and_receivers_are_leading_axes():
    here = scene()
    targets = here.target + np.arange(3)[:, None] * np.array([1e3, -2e3, 500.0, 0.0, 10.0, 0.0])
    pull = acceleration(here.platforms[:, :3], CONSTANTS)
    emission = Emission(Qpsk(), CARRIER)
    offsets = np.arange(50) / 4e6
    together = delay_over(straight(targets), with_acceleration(here.platforms[:1], pull[:1]), HALF)
    whole = receive(emission, together, here.time, offsets)
    assert whole.shape == (3, 50)
    for i, target in enumerate(targets):
        alone = delay_over(straight(target[None]), with_acceleration(here.platforms[:1], pull[:1]), HALF)
        np.testing.assert_array_equal(whole[i], receive(emission, alone, here.time, offsets)[0])
