"""What is recorded: every system and variant as it is, and three settings of each system with errors on; all short."""

from typing import NamedTuple

from quietfix.diagrams.assembly.find import systems
from quietfix.diagrams.commands.catalogue import variants

__all__ = ["CASES", "Case"]

_CLOUD = {"estimators.pf.particles": 200, "estimators.pf_sir.particles": 200}

_SHORT = {
    "three_satellite": {"duration_s": 4},
    "beacon_rocket": {"stop_s": 50.4},
    "beacon_rocket:mode_switch": {"start_s": 179.8, "stop_s": 180.3},
    "beacon_rocket:asynchronous_switch": {"start_s": 179.8, "stop_s": 180.3},
    "beacon_rocket:falcon9": {"start_s": 60, "stop_s": 60.4},
    "satellite_ranging": {"duration_s": 190},
    "satellite_ranging:occulted": {"duration_s": 4750, "period_s": 250},
    "bearing_crossing": {"duration_s": 12},
    "bearing_crossing:manoeuvre": {"duration_s": 500, "period_s": 50},
    "dual_satellite": {"duration_s": 3} | _CLOUD,
    "dual_satellite:signal": {"duration_s": 1} | _CLOUD,
    "dual_satellite:pulse_train": {"duration_s": 1},
    "dual_satellite:low_snr": {"duration_s": 1},
}
"""Settings that make a run short, by system, or by variant where it needs its own."""

_WITH_ERRORS = {
    "three_satellite": {
        "rows": {
            "truth.errors.drop_out_rate": 0.3,
            "truth.errors.outlier_rate": 0.1,
            "truth.motion": "!RandomAcceleration {}",
        },
        "carriers": {
            "truth.errors.attitude_roll_deg": 0.05,
            "truth.errors.sigma_attitude_deg": 0.02,
            "truth.errors.clock_offset_ns": 5,
            "truth.errors.sigma_clock_offset_ns": 3,
            "truth.errors.sigma_platform_position_m": 5,
            "truth.errors.sigma_platform_velocity_mps": 0.01,
            "truth.motion": "!GreatCircle {}",
            "truth.light_time": True,
        },
        "chain": {
            "truth.chain_m": [0.04, 0.4],
            "truth.errors.drop_out_rate": 0.1,
            "truth.correlated": True,
            "belief.correlated": False,
            "belief.sigma_phase_deg": 20,
        },
    },
    "beacon_rocket": {
        "rows": {"sensor.errors.drop_out_rate": 0.3, "sensor.errors.outlier_rate": 0.1},
        "carriers": {
            "sensor.errors.sigma_platform_position_m": 5,
            "sensor.errors.sigma_platform_velocity_mps": 0.01,
            "sensor.sigma_station_residual_mps": 0.05,
            "sensor.minimum_elevation_deg": 5,
        },
        "oscillator": {"bias": "!RandomWalkBias {}", "sensor.errors.drop_out_rate": 0.1, "belief.sigma_mps": 0.2},
    },
    "satellite_ranging": {
        "rows": {"truth.errors.drop_out_rate": 0.1, "truth.errors.outlier_rate": 0.05},
        "carriers": {"truth.sigma_observer_m": 50, "truth.sigma_observer_mps": 0.05},
        "attitude": {
            "truth.errors.attitude_roll_deg": 0.05,
            "truth.errors.sigma_attitude_deg": 0.02,
            "truth.occultation": True,
        },
    },
    "bearing_crossing": {
        "rows": {"truth.errors.drop_out_rate": 0.2, "truth.errors.outlier_rate": 0.1},
        "carriers": {
            "truth.errors.attitude_yaw_deg": 1,
            "truth.errors.sigma_attitude_deg": 0.5,
            "truth.sigma_navigation_m": 50,
        },
        "place": {"truth.target_spread_km": 3, "truth.errors.drop_out_rate": 0.1, "belief.sigma_bearing_deg": 3},
    },
    "dual_satellite": {
        "rows": {
            "truth.errors.drop_out_rate": 0.3,
            "truth.errors.outlier_rate": 0.1,
            "truth.motion": "!RandomAcceleration {}",
        },
        "carriers": {
            "truth.errors.attitude_roll_deg": 0.05,
            "truth.errors.sigma_attitude_deg": 0.02,
            "truth.errors.clock_offset_ns": 5,
            "truth.errors.sigma_clock_offset_ns": 3,
            "truth.errors.sigma_platform_position_m": 5,
            "belief.start": "measurement",
        },
        "stein": {"truth.differences": "stein", "truth.errors.drop_out_rate": 0.1},
    },
}
"""By system and name of the setting."""

_ESTIMATORS = {
    "satellite_ranging with rows": ["ra", "bo", "bcr", "iekf", "ukf", "bank", "ekf"],
    "satellite_ranging with attitude": ["ra", "bo", "iekf", "bank"],
    "three_satellite with chain": ["iekf", "ekf", "ukf", "iekf_hypotheses"],
}
"""Where not all of the scenario's: what looks ahead is not allowed with errors."""


class Case(NamedTuple):
    """A system or variant, what is changed in it, and which estimators run (None: the scenario's)."""

    system: str
    settings: dict
    estimators: list[str] | None = None


def _short(name: str) -> dict:
    return _SHORT.get(name) or _SHORT[name.partition(":")[0]]


CASES = {
    **{
        name: Case(name, _short(name))
        for system in systems()
        for name in (system, *(f"{system}:{variant}" for variant in variants(system)))
    },
    **{
        f"{system} with {title}": Case(system, _short(system) | settings, _ESTIMATORS.get(f"{system} with {title}"))
        for system, ways in _WITH_ERRORS.items()
        for title, settings in ways.items()
    },
}
"""By title."""
