"""I/Q recordings of receivers, or of an emitter, that move: FDOA counts then."""

from functools import partial

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import enu_rotation
from quietfix.systems.iq.modulation import Qpsk
from tests.diagrams.iq_site import CARRIER, EMITTER, RECEIVERS, Clock, ecef, write

RATE, SECONDS = 50e3, 8.0
run = partial(replay, "iq", progress=False)
SETTINGS = ["integration_s=0.25", "half_frequency_hz=400", "position.height_m=500", "position.sigma_height_m=100"]
EAST, NORTH, UP = enu_rotation(*np.radians(EMITTER[:2]))
AIRCRAFT = {  # local east, north, up of the emitter at the start [m], velocity [m/s]
    "left": ((-4000.0, -3000.0, 2500.0), (110.0, 60.0, 0.0)),
    "right": ((3500.0, -4500.0, 3000.0), (-40.0, 120.0, 2.0)),
}


def straight(start, velocity):
    """Earth-fixed position and velocity as functions of time, of a straight line."""
    turn = np.stack([EAST, NORTH, UP])
    p, v = ecef(EMITTER) + np.array(start) @ turn, np.array(velocity) @ turn
    return lambda t: p + np.asarray(t)[..., None] * v, v


def heard(receiver, emitter, seed, rng, snr_db=10.0):
    """Envelope at a receiver on its way, of an emitter on its way; they are functions of time."""
    t = np.arange(int(RATE * SECONDS)) / RATE
    delay = np.zeros(t.size)
    for _ in range(3):
        delay = np.linalg.norm(receiver(t) - emitter(t - delay), axis=-1) / SPEED_OF_LIGHT
    clean = Qpsk(25e3, 0.25).envelope(t - delay, seed) * np.exp(-2j * np.pi * ((CARRIER * delay) % 1))
    noise = rng.standard_normal((t.size, 2)) @ [1, 1j] / np.sqrt(2)
    return clean + 10 ** (-snr_db / 20) * noise


def estimate(report, where):
    """East and north errors of the last estimate, and their covariance."""
    last = report.located.report.result.isel(estimator=0, trial=0, time=-1)
    turn = np.stack([EAST, NORTH])
    return turn @ (last["estimate"].values[:3] - where), turn @ last["covariance"].values[:3, :3] @ turn.T


@pytest.mark.slow
def test_two_receivers_that_move_locate_what_stands(tmp_path):
    """8 seeds: one time and one frequency difference at 31 instants; NEES in its 99.8 % band, and the sign is right."""
    paths = {name: straight(*way) for name, way in AIRCRAFT.items()}
    lines = [
        f"{name},2026-03-01T12:00:{k:02d}Z," + ",".join(map(repr, [*where(float(k)).tolist(), *velocity.tolist()]))
        for name, (where, velocity) in paths.items()
        for k in range(10)
    ]
    table = tmp_path / "platforms.csv"
    table.write_text("name,time,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps\n" + "\n".join(lines) + "\n")
    stands = ecef(EMITTER)
    squared = []
    for seed in range(8):
        rng = np.random.default_rng([seed, 5])
        files = []
        for name, (where, _) in paths.items():
            samples = heard(where, lambda t: np.broadcast_to(stands, (*t.shape, 3)), seed, rng)
            files.append(write(tmp_path, name, samples, Clock(rate=RATE)))
        report = run(file=files, settings=SETTINGS, platforms=table)
        assert not [line for line in report.gaps if "clock" in line]
        error, covariance = estimate(report, stands)
        assert np.sqrt(np.linalg.eigvalsh(covariance)[-1]) < 30.0
        squared.append(error @ np.linalg.solve(covariance, error))
    print(squared)
    low, high = chi2.ppf([0.001, 0.999], 2 * len(squared)) / len(squared)
    assert low < np.mean(squared) < high


@pytest.mark.slow
def test_receivers_that_stand_track_what_moves(tmp_path):
    """A car at 25 m/s: position and velocity at the end within their 99.9 % ellipses, with and without FDOA."""
    where, velocity = straight((-600.0, 200.0, 0.0), (24.0, -7.0, 0.0))
    rng = np.random.default_rng(3)
    files = []
    for name, place in RECEIVERS.items():
        latitude, longitude, height = place
        stands = ecef(place)
        samples = heard(lambda t, stands=stands: np.broadcast_to(stands, (*t.shape, 3)), where, 1, rng)
        point = {"type": "Point", "coordinates": [longitude, latitude, height]}
        files.append(write(tmp_path, name, samples, Clock(rate=RATE), **{"core:geolocation": point}))
    moving = ["position.speed_mps=30", "position.density_m2ps3=0.01"]
    for fdoa, most in (("auto", 0.5), ("left_out", 30.0)):
        report = run(file=files, settings=[*SETTINGS, *moving, f"position.fdoa={fdoa}"])
        last = report.located.report.result.isel(estimator=0, trial=0, time=-1)
        error, covariance = estimate(report, where(last["time"].values + report.times[0]))
        assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 2)
        turn = np.stack([EAST, NORTH])
        spread = turn @ last["covariance"].values[3:6, 3:6] @ turn.T
        off = turn @ (last["estimate"].values[3:6] - velocity)
        assert off @ np.linalg.solve(spread, off) < chi2.ppf(0.999, 2)
        assert np.sqrt(np.linalg.eigvalsh(spread)[-1]) < most
