"""An emitter whose oscillator drifts: a state more, in truth and belief."""

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams.schema.errors import UserError
from tests.own.test_own import study

DRIFTS = {"oscillator.drift_hzps": -0.4}
QUIET = {
    "sensors.doppler.sigma_hz": 1e-6,
    "sensors.doppler.minimum_elevation_deg": -90,
    "oscillator.sigma_offset_hz": 0,
    "oscillator.walk_hz2ps": 0,
    "duration_s": 60,
}
OWN_MOTION = {
    "target": "!RandomMotion {start: !Geodetic {latitude_deg: 46, longitude_deg: 14, height_m: 300}}",
    "start": "!Prior {sigma_position_m: 2000, sigma_velocity_mps: 0.1, sigma_offset_hz: 300, sigma_drift_hzps: 0.5}",
    "oscillator.sigma_drift_hzps": 0.2,
    "oscillator.drift_walk_hz2ps3": 1e-6,
}


def frequency(changes):
    result = study("beacon.yaml", 1, QUIET | changes, estimators=["ekf"], keep="measurements")
    return result["time"].values, result["measurement"].isel(trial=0).sel(row="frequency_satellite").values


def test_the_received_frequency_drifts():
    """To 1e-5 Hz: ten sigmas of the measurement; that a drift of 24 Hz is received Doppler shifted is 6e-4 Hz."""
    times, straight = frequency({})
    _, drifting = frequency(DRIFTS)
    heard = np.isfinite(straight)
    np.testing.assert_allclose((drifting - straight)[heard], -0.4 * times[heard], atol=1e-3)


def test_the_rate_is_a_state():
    result = study("beacon.yaml", 1, DRIFTS | {"duration_s": 20}, estimators=["ukf"])
    assert list(result["state"].values)[-2:] == ["bias", "bias_rate"]
    assert dict(zip(result["state"].values, result["state_units"].values, strict=True))["bias_rate"] == "m/s^2"
    truth = result["truth"].isel(time=0)
    metres = 299_792_458.0 / 401.65e6
    assert float(np.squeeze(truth.sel(state="bias_rate"))[()].max()) == pytest.approx(0.4 * metres, rel=1e-12)


@pytest.mark.parametrize("trials", [40, pytest.param(400, marks=pytest.mark.slow)])
def test_consistent_and_at_the_bound(trials):
    """Truth from the filter's own motion: RMSE/bound as in `test_own`; NEES chi-square, 5 % over five looks."""
    result = study("beacon.yaml", trials, DRIFTS | OWN_MOTION, estimators=["ukf"])
    last = result.sizes["time"] - 1
    at_five = result.isel(time=[last * k // 5 for k in range(1, 6)]).sel(estimator="ukf")
    error = (at_five["estimate"] - at_five["truth"]).sel(state=["x", "y", "z"])
    relative = np.sqrt((error**2).sum("state").mean("trial")) / at_five["bound_position"]
    low, high = (0.93, 1.12) if trials == 400 else (0.75, 1.35)
    assert ((relative > low) & (relative < high)).all(), relative.values
    band = chi2.ppf([0.005, 0.995], 8 * trials) / (8 * trials)
    mean = at_five["nees"].mean("trial") / 8
    assert ((mean > band[0]) & (mean < band[1])).all(), (mean.values, band)


def test_a_spread_of_no_drift_is_refused():
    with pytest.raises(UserError, match=r"oscillator.sigma_drift_hzps: 0.2 is not allowed without drift_hzps"):
        study("beacon.yaml", 1, {"oscillator.sigma_drift_hzps": 0.2})
