"""Two satellites 100 km apart in one orbit and an aircraft below them."""

from dataclasses import dataclass

import numpy as np

from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.trajectories.gravity import GravityConstants
from quietfix.systems.trajectories.kepler import KeplerElements, state_of

CARRIER = 3e9
CONSTANTS = GravityConstants()


def orbit(end=200.0):
    radius = CONSTANTS.radius + 700e3
    half = 50e3 / radius
    states = [
        state_of(KeplerElements(radius, 0.0, np.radians(60), 0.0, 0.0, place), CONSTANTS.mu) for place in (half, -half)
    ]
    return DenseOrbit(np.array(states), end, CONSTANTS, name="satellites")


TARGET = geodetic_state(np.radians(4.0), np.radians(5.0), 10e3, np.radians(60.0), 300.0)


@dataclass(frozen=True)
class Scene:
    """States at one instant."""

    time: float
    target: np.ndarray
    platforms: np.ndarray


def scene(time=10.0):
    target = np.concatenate([TARGET[:3] + time * TARGET[3:], TARGET[3:]])
    return Scene(time, target, inertial_to_earth_fixed(orbit().at(time), time, CONSTANTS.earth_rate))
