"""Truth that moves as the filter believes: errors are as large as the bound, and as the covariance says.

The bound is written out here and shares nothing with `quietfix.diagrams.statistics.bounds`: Tichavsky,
Muravchik and Nehorai, *Posterior Cramer-Rao bounds for discrete-time nonlinear filtering*, IEEE Trans. Signal
Processing 46 (1998) 1386-1396, for linear motion, along each trial's own truth.
"""

import numpy as np
import pytest

from tests.laws.packaged import Packaged, squared_error

EPOCHS = [10, 50, 100, 150]


def bound(packaged, signals, name):
    """Return sqrt of the mean over trials of the bound's position trace, shape (samples,)."""
    truth, carriers = signals["truth"], packaged.platforms(signals)
    block = packaged.wired.estimators[name]
    phi, q = block.motion.transition(truth[0], 1.0), block.motion.process_noise(truth[0], 1.0)
    weight = np.linalg.inv(block.model.noise_covariance())
    covariance = block.bound_prior(truth[0], carriers[0])[0]
    traces = [np.trace(covariance[:, :3, :3], axis1=1, axis2=2)]
    for k in range(1, len(truth)):
        covariance = phi @ covariance @ phi.T + q
        h = block.model.jacobian(truth[k], carriers[k])
        # rows of seconds, hertz and radians: information in units of the predicted deviations
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        scaled = covariance / (sigma[:, :, None] * sigma[:, None, :])
        h = h * sigma[:, None, :]
        information = np.linalg.inv(scaled) + np.einsum("tmi,mn,tnj->tij", h, weight, h)
        covariance = np.linalg.inv(information) * (sigma[:, :, None] * sigma[:, None, :])
        traces.append(np.trace(covariance[:, :3, :3], axis1=1, axis2=2))
    return np.sqrt(np.mean(traces, axis=1))


def consistency(trials, place=(0, 300)):
    """Return RMSE over bound, and mean NEES, at the epochs."""
    settings = {
        "truth.motion": "!RandomAcceleration {}",
        "truth.along_km": place[0],
        "truth.cross_km": place[1],
    }
    packaged = Packaged("three_satellite", trials, settings, ["iekf"])
    _, signals = packaged.run(seed=3)
    rmse = np.sqrt(squared_error(signals, "iekf").mean(axis=1))
    error = signals["iekf/estimate"] - signals["truth"]
    covariance = packaged.covariance(signals, "iekf")
    nees = np.einsum("kti,kti->kt", error, np.linalg.solve(covariance, error[..., None])[..., 0]).mean(axis=1)
    return (rmse / bound(packaged, signals, "iekf"))[EPOCHS], nees[EPOCHS]


@pytest.mark.slow
def test_1600_trials():
    ratio, nees = consistency(1600)
    assert np.all((ratio >= 0.95) & (ratio <= 1.10)), ratio
    assert np.all((nees >= 5.5) & (nees <= 6.5)), nees


def test_200_trials():
    """The same of an eighth of the trials: both scatter by sqrt(8) more.

    The position error is nearly one-dimensional, so that the RMSE of 200 trials scatters by 1/sqrt(400) = 5 %, and
    the mean NEES by sqrt(12/200) = 0.25: three of these beyond what is asserted for 1600.
    """
    ratio, nees = consistency(200)
    assert np.all((ratio >= 0.83) & (ratio <= 1.22)), ratio
    assert np.all((nees >= 5.2) & (nees <= 6.8)), nees
