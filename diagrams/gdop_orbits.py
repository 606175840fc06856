"""The map of `satellite_ranging`: how well the other satellite's orbit can be known, by which orbit it is in."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from diagrams.bound_map import BoundMap, Plane
from diagrams.errors import UserError
from diagrams.satellite_ranging import (
    Kepler,
    Scenario,
    believed_motion,
    believed_sensor,
    gravity,
    kepler_state,
    prior_covariance,
    true_sensor,
)
from systems.clocks import Periodic
from systems.measurement.visibility import EarthOccultation
from systems.motion.kepler import mean_motion
from systems.motion.orbital import OrbitalMotion

__all__ = ["orbit_map"]

Array = NDArray[np.float64]

_KM = 1e3
_SETS = {"angles": ("angles",), "angles + rates": ("angles", "rates"), "all six rows": ()}
_NEAREST = 10e3  # m; a target that comes nearer to the observer is not mapped


def orbit_map(scenario: Scenario, points: tuple[int, int] = (19, 25)) -> BoundMap:
    """Return the map of `satellite_ranging` over inclination and phase of the target's orbit.

    Parameters
    ----------
    scenario : Scenario
        The observer, the other elements of the target's orbit, noise and prior.
    points : (int, int)
        Of the inclination, 0 to 180 deg, and of the mean anomaly at t = 0, -180 to 180 deg.

    Raises
    ------
    UserError
        Where the target's orbit is recorded.
    """
    constants, target = gravity(scenario), scenario.target
    if not isinstance(target, Kepler):
        raise UserError("gdop: target !Sp3 is recorded; the map is over the elements of an orbit, !Kepler")
    inclination, phase = np.linspace(0.0, 180.0, points[0]), np.linspace(-180.0, 180.0, points[1])
    rate = np.degrees(mean_motion(target.semi_major_axis_km * _KM, constants.mu))
    start = np.array(
        [
            [
                kepler_state(
                    dataclasses.replace(target, inclination_deg=float(i), perigee_passage_s=float(-m / rate)),
                    constants,
                    "target",
                )
                for m in phase
            ]
            for i in inclination
        ]
    )
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    flight = OrbitalMotion(constants, true_sensor(scenario).j2)
    observer, targets = [kepler_state(scenario.observer, constants, "observer")], [start]
    for dt in np.diff(times):
        observer.append(flight.propagate(observer[-1], float(dt)))
        targets.append(flight.propagate(targets[-1], float(dt)))
    truth, platforms = np.stack(targets, axis=-2), np.stack(observer)[None, :, None, :]
    seen = np.linalg.norm(truth[..., :3] - platforms[0, :, 0, :3], axis=-1).min(axis=-1) > _NEAREST
    present = None
    if scenario.truth.occultation:
        mask = EarthOccultation(constants.radius + scenario.truth.grazing_height_km * _KM)
        present = mask.visible(truth[seen], platforms)
    belief = scenario.belief
    density = belief.acceleration_density_m2ps3
    return BoundMap(
        plane=Plane(
            ("inclination", "phase"),
            ("inclination of the target's orbit [deg]", "mean anomaly of the target at t = 0 [deg]"),
            (inclination, phase),
        ),
        seen=seen,
        truth=truth[seen],
        platforms=platforms,
        times=times,
        sets={name: believed_sensor(scenario, kinds) for name, kinds in _SETS.items()},
        motion=believed_motion(scenario),
        prior=prior_covariance(scenario),
        stated={
            "noise": "none" if density == 0 else f"{density:g} m^2/s^3",
            "prior": f"{belief.sigma_position_km:g} km, {belief.sigma_velocity_mps:g} m/s per axis",
            "target": f"semi-major axis {target.semi_major_axis_km:g} km, eccentricity {target.eccentricity:g}, "
            f"node {target.raan_deg:g} deg",
        },
        points=np.array([[target.inclination_deg, (-target.perigee_passage_s * rate + 180.0) % 360.0 - 180.0]]),
        points_label="the scenario's target",
        present=present,
        quantities=("position", "velocity"),
        frame="inertial",
        equal=False,
    )
