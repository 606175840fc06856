"""What the laws are tested on: every measurement model, motion model, filter and estimator, and where.

This is the one place to list a new model with an example of it; `test_completeness` fails for one that is missing.
Estimators come from `quietfix.systems.registry.ESTIMATORS`: a new line there is tested without a change here, except
that an options class without usable defaults needs an example in `EXAMPLES`.
"""

from dataclasses import dataclass

import numpy as np

from quietfix.systems.along_track.ahead import Ahead
from quietfix.systems.along_track.anew import Anew
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.angles.direct_azimuth import DirectAzimuth
from quietfix.systems.angles.direction import Direction, DirectionCosines
from quietfix.systems.angles.horizon import HorizonBearing
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.atmosphere.delayed import Delayed
from quietfix.systems.atmosphere.ionosphere import ThinShell
from quietfix.systems.atmosphere.troposphere import Troposphere
from quietfix.systems.biases.bias import Bias, Turn
from quietfix.systems.biases.biased import BiasedModel
from quietfix.systems.biases.walking import WithBiases
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_state
from quietfix.systems.filters.common_mode import CommonModeMonitor
from quietfix.systems.filters.considered import ConsideredStates
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.modified_gain import ModifiedGainKalman
from quietfix.systems.filters.recovery.gate import Gate
from quietfix.systems.filters.recovery.heavy_tails import HuberRows
from quietfix.systems.filters.recovery.second_minimum import SecondMinimum
from quietfix.systems.filters.robust import StudentRows
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.fixes.ranged_position import RangedPosition
from quietfix.systems.fixes.standing import Epochs
from quietfix.systems.geometry.wave_path import WavePath
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.chosen import ChosenRows
from quietfix.systems.measurement.component import Component
from quietfix.systems.measurement.custom import CustomMeasurement
from quietfix.systems.measurement.distance import Range
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.frequency import Frequency
from quietfix.systems.measurement.position import Position
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.measurement.received_power import ReceivedPower
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import GroundTdoa, Tdoa
from quietfix.systems.motion.azimuth_rate import AzimuthRate
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity, WhiteNoiseAcceleration
from quietfix.systems.motion.current_statistical import CurrentStatistical
from quietfix.systems.motion.custom import CustomMotion
from quietfix.systems.motion.drifting_bias import DriftingBias
from quietfix.systems.motion.gauss_markov import GaussMarkov
from quietfix.systems.motion.known_flight import KnownFlight
from quietfix.systems.motion.manoeuvring.coordinated_turn import CoordinatedTurn
from quietfix.systems.motion.manoeuvring.driven import Driven
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.motion.pass_oscillator import PassOscillator
from quietfix.systems.motion.random_walk import RandomWalk
from quietfix.systems.motion.side_by_side import SideBySide
from quietfix.systems.motion.stationary import Stationary
from quietfix.systems.options.custom import Custom
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.interacting.imm import Imm
from quietfix.systems.options.interacting.models import AsBelieved
from quietfix.systems.options.interacting.transitions import Matrix, Sojourn
from quietfix.systems.options.motions import ConstantVelocity as WrittenVelocity
from quietfix.systems.options.motions import WhiteNoiseAcceleration as WrittenAcceleration
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.registry import ESTIMATORS, object_at
from quietfix.systems.trajectories.gravity import GravityConstants
from quietfix.systems.trajectories.kepler import KeplerElements, mean_motion, state_of

# ------------------------------------------------------------------------------------------------ geometries

_AXIS = 6378.137e3 + 700e3
_INCLINATION = np.radians(60.0)
_EARTH = GravityConstants()
PASS = 150.0
"""Length of a pass of the satellites [s]."""


def satellites(time, formation="tri"):
    """Return the Earth-fixed states of three satellites, shape (..., 3, 6); two-body orbits are enough here."""
    time = np.asarray(time, dtype=float)
    node = 69.28e3 / _AXIS / np.sin(_INCLINATION)
    if formation == "tri":
        nodes, latitudes = np.array([node, 0, 0]), np.array([-node * np.cos(_INCLINATION), -40e3 / _AXIS, 40e3 / _AXIS])
    else:
        nodes, latitudes = np.zeros(3), np.array([0, -80e3 / _AXIS, 80e3 / _AXIS])
    latitudes = latitudes + mean_motion(_AXIS, _EARTH.mu) * time[..., None]
    elements = KeplerElements(_AXIS, 0.0, _INCLINATION, nodes, 0.0, latitudes)
    return inertial_to_earth_fixed(state_of(elements, _EARTH.mu), time[..., None])


def place(along, cross, height=10e3, course=60.0, speed=300.0):
    """Return a target's Earth-fixed state, (along, cross) metres from below satellite 0 at mid pass."""
    state = satellites(PASS / 2)[0]
    up = state[:3] / np.linalg.norm(state[:3])
    forward = state[3:] - up * (up @ state[3:])
    forward /= np.linalg.norm(forward)
    a, c = np.asarray(along, dtype=float)[..., None] / 6378137.0, np.asarray(cross, dtype=float)[..., None] / 6378137.0
    direction = np.cos(c) * (np.cos(a) * up + np.sin(a) * forward) + np.sin(c) * np.cross(forward, up)
    latitude, longitude, _ = ecef_to_geodetic(6378137.0 * direction)
    return geodetic_state(latitude, longitude, height, np.radians(course), speed)


PLACES = {"(0,50)": (0e3, 50e3), "(0,300)": (0e3, 300e3), "(150,-500)": (150e3, -500e3), "(-300,700)": (-300e3, 700e3)}
"""The reference's four places of the target, (along, cross) in metres."""


@dataclass(frozen=True)
class Geometry:
    """Targets (k, 6) and the platforms (1, p, 6) that see them."""

    targets: np.ndarray
    platforms: np.ndarray


def _over_satellites():
    rng = np.random.default_rng(1)
    targets = place(*np.array(list(PLACES.values())).T)
    more = place(*rng.uniform(-800e3, 800e3, (2, 8)), rng.uniform(0, 12e3, 8), rng.uniform(0, 360, 8), 250.0)
    return Geometry(np.concatenate([targets, more]), satellites(PASS / 2)[None])


def _over_stations():
    rng = np.random.default_rng(2)
    latitude, longitude = np.radians(49.0), np.radians(8.0)

    def around(n, reach):
        return latitude + rng.uniform(-reach, reach, n) / 6.37e6, longitude + rng.uniform(-reach, reach, n) / 4.2e6

    stations = geodetic_state(*around(5, 60e3), rng.uniform(0, 500, 5), 0.0, 0.0)
    targets = geodetic_state(
        *around(12, 80e3), rng.uniform(1e3, 12e3, 12), rng.uniform(0, 6.28, 12), rng.uniform(60, 300, 12), 5.0
    )
    return Geometry(targets, stations[None])


def _around_aircraft():
    rng = np.random.default_rng(3)
    aircraft = np.array([[5e3, -2e3, 8e3, 160.0, 40.0, 0.0], [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]])
    # not due west of it, where a difference of azimuths that are not wrapped means nothing
    azimuth, distance = rng.uniform(-2.8, 2.8, 12), rng.uniform(10e3, 80e3, 12)
    targets = np.zeros((12, 6))
    targets[:, :2] = aircraft[0, :2] + distance[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    targets[:, 2], targets[:, 3:] = rng.uniform(0, 12e3, 12), rng.uniform(-200, 200, (12, 3))
    return Geometry(targets, aircraft[None])


def _angles():
    targets = np.zeros((12, 6))
    targets[:, 0], targets[:, 1] = np.linspace(-3.0, 3.0, 12), 0.01
    return Geometry(targets, np.full((1, 3, 6), 100.0))


def _between_satellites():
    """Inertial: twelve orbits seen from a satellite in a high one."""
    rng = np.random.default_rng(4)
    turn = rng.uniform(0, 2 * np.pi, (3, 12))
    low = KeplerElements(rng.uniform(7e6, 9e6, 12), rng.uniform(0, 0.05, 12), rng.uniform(0.3, 2.5, 12), *turn)
    high = KeplerElements(22e6, 0.2, np.radians(72.0), np.radians(30.0), np.radians(60.0), 0.4)
    return Geometry(state_of(low, _EARTH.mu), state_of(high, _EARTH.mu)[None, None])


EARTH_FIXED = {"satellites": _over_satellites(), "stations": _over_stations()}
GEOMETRIES = {**EARTH_FIXED, "orbits": _between_satellites(), "aircraft": _around_aircraft(), "angles": _angles()}

# ---------------------------------------------------------------------------------------- measurement models

CARRIER = 3e9
WAVELENGTH = SPEED_OF_LIGHT / CARRIER


def tdoa(**options):
    """Return the TDOA model of the three satellites, 20 ns."""
    return Tdoa(20e-9, **options)


def fdoa(**options):
    """Return their FDOA model, 1 Hz."""
    return Fdoa(1.0, CARRIER, **options)


def phase(**options):
    """Return the two-axis phase of satellite 0, 15 degrees, 3 m."""
    return InterferometerPhase(np.radians(15.0), 3.0, WAVELENGTH, **options)


def six():
    """Return the stack of all six rows of three_satellite."""
    return Stack([tdoa(), fdoa(), phase()])


def _renamed(model):
    model.names = tuple(f"{row}_{model.platform}" for row in model.names)
    return model


KINEMATICS = dict(zip(ROWS, (1e-3, 1e-3, 1e-5, 1e-5, 10.0, 0.05), strict=True))
"""Standard deviations of what one satellite measures of another."""


def kinematics(rows=tuple(ROWS), **options):
    """Return the model of satellite_ranging."""
    return RelativeKinematics({row: KINEMATICS[row] for row in rows}, **options)


class Distance(Range):
    """A range as a user may write it: without the Jacobian."""

    def __init__(self):
        super().__init__(5.0, [0])

    def predict(self, target, platforms):
        x, y, z = np.moveaxis(target[..., :3] - platforms[..., 0, :3], -1, 0)
        return np.sqrt(x**2 + y**2 + z**2)[..., None]


ADDED = [
    Bias("first", "m", 10.0, rows={"range_0": 1.0}),
    Bias("both", "m", 10.0, 0.1, rows={"range_0": -1.0, "range_1": 0.5, "range_2": 2.0}, considered=True),
    Bias("none", "m", 10.0, rows={"range_7": 1.0}),
]
"""Biases of ranges, one of them in none that is measured."""


def turned(*rows, platform=0, body=None):
    """Return the three angles by which the axes of a platform are turned."""
    given = dict.fromkeys(rows, 1.0)
    return [Bias(f"turn_{k}", "rad", 0.1, rows=given, turn=Turn(platform, k, 3, body)) for k in range(3)]


MEDIA = [Troposphere(), ThinShell(40.0, 350e3, 1e9)]
_STATIONS = {"receivers": (1, 2, 3, 4), "reference": 0}

MEASUREMENTS = {
    "tdoa": (tdoa(), "satellites"),
    "tdoa, correlated": (tdoa(correlated=True), "satellites"),
    "tdoa, light time": (tdoa(light_time=True), "satellites"),
    "tdoa, other reference": (tdoa(receivers=(0, 2), reference=1), "satellites"),
    "fdoa": (fdoa(), "satellites"),
    "fdoa, correlated": (fdoa(correlated=True), "satellites"),
    "fdoa, paper sign": (fdoa(paper_sign=True), "satellites"),
    "fdoa, light time": (fdoa(light_time=True), "satellites"),
    "fdoa, light time, paper sign": (fdoa(light_time=True, paper_sign=True), "satellites"),
    "phase": (phase(), "satellites"),
    "phase, wrapped": (phase(wrapped=True), "satellites"),
    "phase b": (phase(axes=["b"]), "satellites"),
    "altitude": (Altitude(50.0), "satellites"),
    "all six": (six(), "satellites"),
    "all six, wrapped, correlated, light time": (
        Stack(
            [tdoa(correlated=True, light_time=True), fdoa(correlated=True, light_time=True), phase(wrapped=True)],
        ),
        "satellites",
    ),
    "stack of stacks": (Stack([Stack([tdoa(correlated=True), phase(wrapped=True)]), Altitude(3e3)]), "satellites"),
    "tdoa, stations": (Tdoa(50e-9, correlated=True, **_STATIONS), "stations"),
    "tdoa along the ground, stations": (GroundTdoa(50e-9, **_STATIONS), "stations"),
    "tdoa by a mirror, stations": (GroundTdoa(50e-9, **_STATIONS, path=WavePath(90e3)), "stations"),
    "tdoa, stations, light time": (Tdoa(50e-9, light_time=True, **_STATIONS), "stations"),
    "fdoa, stations": (Fdoa(1.0, 1.09e9, **_STATIONS), "stations"),
    "range rates, stations": (RangeRate(0.03, range(5)), "stations"),
    "range rates at some stations": (RangeRate(0.03, [3, 1]), "stations"),
    "range rates, target at rest": (RangeRate(0.03, [0, 2], at_rest=True), "satellites"),
    "altitude, stations": (Altitude(30.0), "stations"),
    "received power": (ReceivedPower(4.0, -30.0, 2.5, [4, 0]), "stations"),
    "ranges": (Range(5.0, [0, 2, 3]), "stations"),
    "azimuth over the horizon": (HorizonBearing(0.02, platform=2), "stations"),
    "azimuth and elevation over the horizon": (HorizonBearing(0.02, 0.01, platform=1), "stations"),
    "frequency": (Frequency(2.0, 4e8, [1, 3]), "stations"),
    "five epochs of one platform": (Epochs(Stack([Range(5.0, [0]), RangeRate(0.03, [0])]), 5), "stations"),
    "component": (Component(2, 30.0, "height", "m"), "stations"),
    "chosen rows": (
        ChosenRows(Stack([HorizonBearing(0.02, 0.01, platform=1), Range(5.0, [0, 2, 3])]), ["range_2", "azimuth"]),
        "stations",
    ),
    "tdoa and altitude, stations": (
        Stack([Tdoa(50e-9, correlated=True, **_STATIONS), Altitude(30.0, "barometric")]),
        "stations",
    ),
    "relative kinematics": (kinematics(), "orbits"),
    "relative kinematics, j2": (kinematics(j2=True), "orbits"),
    "relative kinematics, angles": (kinematics(("azimuth", "elevation")), "orbits"),
    "relative kinematics, without angles": (kinematics(tuple(ROWS)[2:]), "orbits"),
    "stack of relative kinematics": (Stack([kinematics(tuple(ROWS)[:4]), kinematics(tuple(ROWS)[4:])]), "orbits"),
    "ranged position": (RangedPosition(kinematics()), "orbits"),
    "bearing": (Bearing(np.radians(2.0)), "aircraft"),
    "bearing, elevation": (Bearing(np.radians(2.0), np.radians(1.0)), "aircraft"),
    "bearings of two": (Stack([Bearing(0.03), _renamed(Bearing(0.02, platform=1))]), "aircraft"),
    "direct azimuth": (DirectAzimuth(0.03), "angles"),
    "direction": (Direction(0.01), "satellites"),
    "direction, another carrier": (Direction(0.01, 0.02, platform=2), "satellites"),
    "direction cosines": (DirectionCosines(0.01), "satellites"),
    "direction, delay, doppler": (
        Stack([Direction(0.01), tdoa(receivers=(1,)), fdoa(receivers=(1,), light_time=True)]),
        "satellites",
    ),
    "position": (Position(5e3), "satellites"),
    "custom": (CustomMeasurement(Range(5.0, [0, 1]), [3, 1]), "stations"),
    "custom, by differences": (CustomMeasurement(Distance(), [2], has_jacobian=False), "stations"),
    "delayed tdoa": (Delayed(tdoa(light_time=True), MEDIA, (1, 2), 0, 1 / SPEED_OF_LIGHT), "satellites"),
    "delayed fdoa": (Delayed(fdoa(), MEDIA, (1, 2), 0, -1 / WAVELENGTH, doppler=True), "satellites"),
    "delayed ranges": (Delayed(Range(5.0, [0, 2, 3]), MEDIA, [0, 2, 3]), "stations"),
    "delayed frequency": (
        Delayed(Frequency(2.0, 4e8, [1, 3]), MEDIA, [1, 3], None, -4e8 / SPEED_OF_LIGHT, doppler=True),
        "stations",
    ),
    # the states of these laws are six; those that are ahead are in tests/systems/test_ahead.py
    "frequency of satellites, none of them ahead": (
        Ahead(Frequency(2.0, 4e8, [1]), {}, 3, GravityConstants(), turning=True),
        "satellites",
    ),
    # of six states the first three are the position, the others biases
    "custom ranges with biases": (BiasedModel(CustomMeasurement(Range(5.0, [0, 1]), [3, 2]), 3, ADDED), "stations"),
    "custom, by differences, in orbit": (CustomMeasurement(Distance(), [1], has_jacobian=False), "satellites"),
}
"""Every measurement model, in every option that changes its mathematics: model and geometry."""


# --------------------------------------------------------------------------------------------- motion models


class Turning(MotionModel):
    """A turn at a rate that is part of the state: a motion that is not linear, for filters that must cope."""

    names = ("x", "y", "heading", "rate")
    units = ("m", "m", "rad", "rad/s")
    speed = 100.0

    def propagate(self, state, dt):
        x, y, heading, rate = np.moveaxis(state, -1, 0)
        along = self.speed * dt
        return np.stack([x + along * np.cos(heading), y + along * np.sin(heading), heading + rate * dt, rate], axis=-1)

    def transition(self, state, dt):
        phi = np.zeros((*state.shape, 4)) + np.eye(4)
        phi[..., 0, 2] = -self.speed * dt * np.sin(state[..., 2])
        phi[..., 1, 2] = self.speed * dt * np.cos(state[..., 2])
        phi[..., 2, 3] = dt
        return phi

    def process_noise(self, state, dt):
        return np.diag([1.0, 1.0, 1e-4, 1e-4]) * dt


_STATE = np.array([6.4e6, -1e5, 2e5, 250.0, -120.0, 30.0])
_LIMITS = [44.0, 14.0, 0.5], [-0.6, -9.7, -0.5]
_FLIGHT = np.array(
    [
        [1e3, 5e3, -20.0, 80.0, 220.0, -1.0, 6.0, 5.7, -0.1, 220.0],
        [9e3, 6e3, 50.0, 2e3, 1e3, -20.0, -0.1, -9.6, 0.3, 90.0],
    ]
)
MOTIONS = {
    "constant velocity": (ConstantVelocity(0.1), _STATE + np.arange(5)[:, None] * [1e5, 2e4, -3e4, 10, 20, 30]),
    "constant velocity, standing still": (ConstantVelocity(0.0), _STATE[None]),
    "constant velocity, one axis": (ConstantVelocity(2.0, axes=1), np.array([[3e3, 20.0], [-1e3, 5.0]])),
    "white noise acceleration": (WhiteNoiseAcceleration(0.5), _STATE[None]),
    "white noise acceleration, plane": (WhiteNoiseAcceleration(0.5, axes=2), np.array([[1e3, -2e3, 10.0, 20.0]])),
    "current statistical": (CurrentStatistical(0.01, *_LIMITS, 1.0, [20.0]), _FLIGHT),
    "current statistical, input held": (
        CurrentStatistical(0.3, *_LIMITS, 0.0, [20.0], mean=np.zeros(3)),
        _FLIGHT,
    ),
    "current statistical, no bias": (CurrentStatistical(2.0, *_LIMITS, 5.0, [], "filtered"), _FLIGHT[:, :9]),
    "known flight": (KnownFlight([20.0]), _FLIGHT),
    "random walk": (RandomWalk([0.1, 2.0], ["a", "b"], ["m/s", "rad"]), np.array([[1.0, 2.0], [30.0, -4.0]])),
    "drifting bias": (DriftingBias(0.3, 2e-4), np.array([[3.0, 0.1], [-20.0, 0.5]])),
    "side by side": (
        SideBySide([WhiteNoiseAcceleration(0.5), RandomWalk([0.1], ["bias"], ["m/s"])]),
        np.append(_STATE, 30.0)[None] * [[1.0], [1.01]],
    ),
    "side by side, one of them in orbit": (
        SideBySide([OrbitalMotion(density=1e-6), RandomWalk([0.0], ["bias"], ["m/s"])]),
        np.concatenate([_between_satellites().targets, np.ones((len(_between_satellites().targets), 1))], axis=-1),
    ),
    "pass oscillator": (PassOscillator([1e3, 1.0, 1e-2], 100.0, 1e-6), np.array([[3e3, 2e3, 1e3, 300.0, 1.2, 0.01]])),
    "anew in every pass": (Anew(DriftingBias(1e-2, 1e-6), [300.0, 0.5], 100.0), np.array([[120.0, -0.2]])),
    "pass oscillator, bias alone": (PassOscillator([1e3], 100.0), np.array([[3e3, 2e3, 1e3, 300.0]])),
    "orbit, two-body": (OrbitalMotion(j2=False), _between_satellites().targets),
    "orbit, j2": (OrbitalMotion(density=1e-6), _between_satellites().targets),
    "orbit, second order": (OrbitalMotion(j2=True, method="second_order"), _between_satellites().targets),
    "stationary": (Stationary(2), np.array([[1e4, 5e4], [-3e3, 2e3]])),
    "stationary, random walk": (Stationary(3, 4.0), np.array([[1e4, 5e4, 1e2]])),
    "azimuth rate": (AzimuthRate(3e-9), np.array([[1.3, 0.003], [4.0, -0.01]])),
    "fading error": (GaussMarkov(100.0, 30.0), np.array([[120.0, -80.0], [10.0, 3.0]])),
    "biases beside a straight line": (
        WithBiases(WhiteNoiseAcceleration(0.5), ADDED),
        np.append(_STATE, [30.0, -2.0, 0.5])[None],
    ),
    "biases beside an orbit": (
        WithBiases(OrbitalMotion(density=1e-6), ADDED),
        np.concatenate([_between_satellites().targets, np.full((12, 3), 5.0)], axis=-1),
    ),
    "biases beside the current statistical model": (
        WithBiases(CurrentStatistical(0.3, *_LIMITS, 0.5, [20.0], mean=np.zeros(3)), ADDED),
        np.concatenate([_FLIGHT, np.full((2, 3), 5.0)], axis=-1),
    ),
    "custom": (CustomMotion(OrbitalMotion(density=1e-6)), _between_satellites().targets),
    "custom, by differences": (CustomMotion(OrbitalMotion(), has_transition=False), _between_satellites().targets),
    "coordinated turn": (CoordinatedTurn(-0.1, 0.5), _STATE[None]),
    "coordinated turn, plane": (CoordinatedTurn(1e-3, 0.5, axes=2), np.array([[1e3, -2e3, 10.0, 20.0]])),
    "orbit, driven": (Driven(OrbitalMotion(density=1e-6), 2.0), _between_satellites().targets),
    "turning": (Turning(), np.array([[10.0, 20.0, 0.3, 0.01], [-5e3, 1e3, -2.0, 0.05]])),
}
"""Every motion model: model and example states (k, n)."""

# ---------------------------------------------------------------------------------------- filters, estimators

FILTERS: dict[str, GaussianFilter] = {
    "ekf": IteratedExtendedKalman(max_iterations=1),
    "iekf": IteratedExtendedKalman(),
    "iekf, five iterations": IteratedExtendedKalman(5, 1e-300),
    "modified gain": ModifiedGainKalman(),
    "ukf": UnscentedKalman(),
    "ukf, alpha 0.5, beta 2": UnscentedKalman(0.5, 2.0, 0.0),
    "ukf, kappa": UnscentedKalman(1.0, 2.0, -3.0),
    "common-mode monitor": CommonModeMonitor(),
    "common-mode monitor, ekf": CommonModeMonitor(IteratedExtendedKalman(max_iterations=1), state=3),
    # with finitely many degrees of freedom it is not the Kalman filter, and should not be
    "student rows": StudentRows(IteratedExtendedKalman(), freedom=1e15),
    "considered states, none of them": ConsideredStates(),
    "ukf, alpha 0.1": UnscentedKalman(0.1, 2.0, 0.0),
    # nothing is so far off: it is the Kalman filter
    "huber rows": HuberRows(IteratedExtendedKalman(), threshold=1e15),
    "second minimum": SecondMinimum(),
}
"""Every Gaussian filter, as bare functions; `_registered` adds those that are written as an estimator's options."""


def _registered():
    """Registered estimators that are a filter with an update of their own."""
    known = {type(algorithm).update for algorithm in FILTERS.values()}
    kinds = {name: object_at(path) for name, path in ESTIMATORS.items()}
    return {n: kind() for n, kind in kinds.items() if issubclass(kind, GaussianFilter) and kind.update not in known}


FILTERS |= _registered()

EXAMPLES = {
    "custom": [Custom(class_="quietfix.systems.filters.iterated_extended:IteratedExtendedKalman")],
    # the gates are open: what shut ones do is in test_recovery
    "ekf": [Ekf(), Ekf(gate=Gate(probability=1.0))],
    "iekf": [Iekf(), Iekf(max_iterations=3, tolerance=1.0), Iekf(gate=Gate(1.0, "epoch")), Iekf(retry=True)],
    "imm": [
        Imm(models={"calm": AsBelieved(), "agile": AsBelieved(4.0)}, transitions=Sojourn({"calm": 60.0, "agile": 9.0})),
        Imm(
            models={"a": WrittenAcceleration(0.01), "b": AsBelieved(0.3), "c": WrittenVelocity(5.0)},
            # a power of matrices of shorter steps: the same laws hold at any step
            transitions=Matrix([[0.92, 0.06, 0.02], [0.08, 0.85, 0.07], [0.03, 0.12, 0.85]]),
            filter=Ukf(),
        ),
    ],
    "ukf": [Ukf(), Ukf(alpha=0.5, beta=2.0, kappa=1.0)],
}
"""Options of registered estimators where the defaults are not enough, or are not all."""


OWN_SENSOR = ("ra", "ra_paper", "bank")
"""Registered estimators that work with one sensor only: the same laws on a scene of theirs, in test_ranging_laws."""

BEARINGS_ONLY = ("range_bank", "crossing", "ml")
"""The same, for those that locate by bearings alone, in test_bearing_locators."""

SAMPLED = ("pf", "pf_sir")
"""Those that draw particles: the same laws, exact or within their scatter, in test_particle_laws."""


SEVERAL_MOTIONS = ("imm",)
"""Those that believe in several motions: their covariance does not grow by one; see test_interacting."""


def estimators():
    """Return options of every registered estimator that takes any sensor, by a readable name."""
    cases = {}
    for name, path in ESTIMATORS.items():
        if name in (*OWN_SENSOR, *BEARINGS_ONLY, *SAMPLED):
            continue
        for i, options in enumerate(EXAMPLES.get(name) or [object_at(path)()]):
            cases[f"{name} {i}" if i else name] = options
    return cases
