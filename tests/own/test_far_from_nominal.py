"""Systems far from the packaged ones: where filters and bounds must agree all the same,
and symmetries of the Earth."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams import run_study

SHIP = str(Path(__file__).parent / "ship.yaml")
ESTIMATORS = "estimators: {ukf: !Ukf {}, iekf: !Iekf {}}\n"

SYSTEMS = {
    "a ship at the pole": """
frame: earth_fixed
duration_s: 900
platforms:
  east: !Kepler {semi_major_axis_km: 7078, inclination_deg: 90, true_anomaly_deg: 60}
  west: !Kepler {semi_major_axis_km: 7078, inclination_deg: 88, raan_deg: 3, true_anomaly_deg: 58}
  third: !Kepler {semi_major_axis_km: 7278, inclination_deg: 98, raan_deg: 80, true_anomaly_deg: 70}
target: !RandomMotion {start: !GreatCircle {latitude_deg: 89.95, longitude_deg: 14, speed_mps: 8}}
sensors:
  fdoa: !Fdoa {reference: west, sigma_hz: 1, carrier_mhz: 1626, every_s: 2, minimum_elevation_deg: 5,
    elevation_at: target}
  sea: !Altitude {sigma_m: 20, every_s: 10}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0e-4}}
start: !Prior {sigma_position_m: 2000, sigma_velocity_mps: 1}
""",
    "a satellite, an aircraft and a ground station across the date line": """
frame: earth_fixed
duration_s: 300
platforms:
  leo: !Kepler {semi_major_axis_km: 7178, inclination_deg: 100, raan_deg: 160, true_anomaly_deg: -20,
    eccentricity: 0.02}
  ground: !Geodetic {latitude_deg: -17.2, longitude_deg: 179.0, height_m: 50}
  plane: !GreatCircle {latitude_deg: -18, longitude_deg: 179.7, height_m: 11000, course_deg: 60, speed_mps: 230}
target: !RandomMotion {start: !GreatCircle {latitude_deg: -17, longitude_deg: 179.95, height_m: 30,
    course_deg: 100, speed_mps: 12}}
sensors:
  tdoa: !Tdoa {reference: ground, sigma_ns: 100, light_time: true}
  fdoa: !Fdoa {reference: plane, receivers: [leo, ground], sigma_hz: 3, carrier_mhz: 1500, every_s: 6}
  bear: !Bearing {platform: plane, sigma_deg: 1, sigma_elevation_deg: 1, every_s: 7}
  alt: !Altitude {sigma_m: 20, every_s: 60}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0e-2}}
start: !Prior {sigma_position_m: 2000, sigma_velocity_mps: 10}
""",
    "an eccentric and a retrograde orbit over a beacon in the south": """
frame: earth_fixed
duration_s: 6000
platforms:
  heo: !Kepler {semi_major_axis_km: 26600, eccentricity: 0.72, inclination_deg: 63.4, raan_deg: 200,
    argument_of_perigee_deg: 90, true_anomaly_deg: 160}
  retro: !Kepler {semi_major_axis_km: 7400, eccentricity: 0.03, inclination_deg: 130, raan_deg: 40,
    argument_of_perigee_deg: 10, true_anomaly_deg: 100}
target: !RandomMotion {start: !Geodetic {latitude_deg: -41, longitude_deg: 174.8, height_m: 300}}
oscillator: {carrier_mhz: 401.65, offset_hz: -800, sigma_offset_hz: 100, walk_hz2ps: 0.01}
sensors:
  doppler: !Frequency {sigma_hz: 2, carrier_mhz: 401.65, every_s: 20, minimum_elevation_deg: 5, elevation_at: target}
  ground: !Altitude {sigma_m: 50, every_s: 600}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0e-9}}
start: !Prior {sigma_position_m: 2000, sigma_velocity_mps: 0.1, sigma_offset_hz: 300}
""",
    "three passes with gaps between them": """
frame: earth_fixed
duration_s: 20000
platforms:
  satellite: !Kepler {semi_major_axis_km: 6978, inclination_deg: 82, raan_deg: 10, true_anomaly_deg: 30}
target: !RandomMotion {start: !Geodetic {latitude_deg: 76, longitude_deg: 14, height_m: 300}}
oscillator: {carrier_mhz: 401.65, offset_hz: 1200, sigma_offset_hz: 300, walk_hz2ps: 0.01}
sensors:
  doppler: !Frequency {sigma_hz: 2, carrier_mhz: 401.65, every_s: 10, minimum_elevation_deg: 5, elevation_at: target}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0e-9}}
start: !Prior {sigma_position_m: 1000, sigma_velocity_mps: 0.1, sigma_offset_hz: 300}
""",
    "a satellite in inertial axes": """
frame: inertial
duration_s: 6000
platforms:
  watcher: !Kepler {semi_major_axis_km: 7478, inclination_deg: 98, raan_deg: 10, true_anomaly_deg: 30}
  ground: !Geodetic {latitude_deg: -30, longitude_deg: 179.9, height_m: 300}
target: !RandomMotion {start: !Kepler {semi_major_axis_km: 7678, eccentricity: 0.02, inclination_deg: 70,
    raan_deg: 15, true_anomaly_deg: 35}, sigma_position_m: 500}
sensors:
  angles: !Relative {platform: watcher, every_s: 20, sigma_radial_velocity_mps: 1}
  range: !Range {stations: [ground], sigma_m: 50, every_s: 300}
belief: {motion: !Orbital {density_m2ps3: 1.0e-6}}
start: !Prior {sigma_position_m: 2000, sigma_velocity_mps: 5}
""",
    "missing rows, correlated and of arrival times": """
frame: local
duration_s: 200
platforms:
  a: !Fixed {east_km: -8, north_km: -5, up_m: 30}
  b: !Fixed {east_km: 9, north_km: -4, up_m: 120}
  c: !Fixed {east_km: 1, north_km: 9, up_m: 60}
  d: !Fixed {up_m: 5}
target: !RandomMotion {start: !Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}}
sensors:
  tdoa: !Tdoa {reference: d, sigma_ns: 60, correlated: true, errors: {drop_out_rate: 0.4}}
  toa: !Toa {sigma_ns: 50, every_s: 3, errors: {drop_out_rate: 0.3}}
  bar: !Altitude {sigma_m: 100, every_s: 5}
start: !Prior {sigma_position_m: 800, sigma_velocity_mps: 30}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0}}
""",
    "ten times the noise": """
frame: local
duration_s: 200
platforms:
  a: !Fixed {east_km: -8, north_km: -5, up_m: 30}
  b: !Fixed {east_km: 9, north_km: -4, up_m: 120}
  c: !Fixed {east_km: 1, north_km: 9, up_m: 60}
  d: !Fixed {up_m: 5}
target: !RandomMotion {start: !Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}}
sensors:
  tdoa: !Tdoa {reference: d, sigma_ns: 300}
  bearing: !Bearing {platform: a, sigma_deg: 5, every_s: 4, offset_s: 2}
  bar: !Altitude {sigma_m: 300, every_s: 5}
start: !Prior {sigma_position_m: 800, sigma_velocity_mps: 30}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0}}
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("title", SYSTEMS)
def test_consistent_and_at_the_bound(title, tmp_path):
    file, trials = tmp_path / "far.yaml", 300
    file.write_text(SYSTEMS[title] + ESTIMATORS)
    result = run_study(str(file), trials=trials)
    last = result.sizes["time"] - 1
    result = result.isel(time=[last * k // 5 for k in range(1, 6)])
    error = (result["estimate"] - result["truth"]).sel(state=["x", "y", "z"])
    ratio = np.sqrt((error**2).sum("state").mean("trial")) / result["bound_position"]
    # of one weak direction: standard deviation 1 / sqrt(2 trials), 0.041; three of them
    assert ratio.size == 10 and np.abs(ratio - 1).max() < 0.12, ratio.values
    freedom = trials * result.sizes["state"]
    looks = 5 * len(SYSTEMS)
    low, high = chi2.ppf([0.025 / looks, 1 - 0.025 / looks], freedom) / freedom
    mean = result["nees"].mean("trial") / result.sizes["state"]
    assert ((mean > low) & (mean < high)).all(), (mean.values, low, high)


def bound(node, inclination, latitude, longitude, course):
    """Bound of the position of a ship that two satellites hear, along its course."""
    orbit = f"semi_major_axis_km: 7078, inclination_deg: {inclination}"
    changes = {
        "platforms.east": f"!Kepler {{{orbit}, raan_deg: {node}}}",
        "platforms.west": f"!Kepler {{{orbit}, raan_deg: {node + 1}, true_anomaly_deg: -0.7}}",
        "target": f"!GreatCircle {{latitude_deg: {latitude}, longitude_deg: {longitude}, course_deg: {course}}}",
        "duration_s": 100,
    }
    return run_study(SHIP, trials=1, set=changes, estimators=["ukf"])["bound_position"].values


def test_nothing_depends_on_the_hemisphere_or_the_longitude():
    here = bound(0, 60, 12, 14, 70)
    # what rounding of places of 7e6 m leaves, 1e-9 m, times the 1e4 or so that the geometry amplifies it
    np.testing.assert_allclose(bound(0, -60, -12, 14, 110), here, rtol=1e-9)
    np.testing.assert_allclose(bound(165.9, 60, 12, 179.9, 70), here, rtol=1e-9)
    np.testing.assert_allclose(bound(-194, 60, 12, -180, 70), here, rtol=1e-9)
