"""The filters against implementations that nobody here wrote: FilterPy and Stone Soup, on the same numbers."""

import datetime

import numpy as np
import pytest

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from tests.laws.cases import PLACES
from tests.laws.rig import Linear, Scene

EPOCHS, TRIALS = 30, 3
# Both invert S as it is: TDOA as metres of range difference keeps its condition number in what they can do.
METRES = np.array([SPEED_OF_LIGHT, SPEED_OF_LIGHT, 1.0, 1.0, 1.0, 1.0])


def ours(algorithm, scene):
    """Means and covariances after each epoch, (epochs, trials, ...), by the bare functions."""
    whitener = Whitener(scene.model.noise_covariance())
    mean, covariance = scene.mean, np.broadcast_to(scene.covariance, (scene.trials, 6, 6))
    rows = []
    for k in range(scene.epochs):
        if k:
            mean, covariance = algorithm.predict(mean, covariance, scene.motion, 1.0)
        carriers = scene.platforms[k].reshape(-1, 3, 6)
        result = algorithm.update(mean, covariance, Observation(scene.measurement[k], carriers, whitener), scene.model)
        mean, covariance = result.mean, result.covariance
        rows.append((mean, covariance, result.nis))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def assert_close(own, other, tolerance):
    """Means in standard deviations, covariances in products of them."""
    sigma = np.sqrt(np.diagonal(own[1], axis1=-2, axis2=-1))
    assert (np.abs(own[0] - other[0]) / sigma).max() < tolerance
    assert (np.abs(own[1] - other[1]) / (sigma[..., None] * sigma[..., None, :])).max() < tolerance


def over_trials(scene, one):
    """Run ``one(trial)``, which yields (mean, covariance) per epoch, for every trial."""
    runs = [list(one(i)) for i in range(scene.trials)]
    return tuple(np.array([[step[j] for step in run] for run in runs]).swapaxes(0, 1) for j in range(2))


@pytest.fixture(scope="module", params=list(PLACES)[1:3])
def scene(request):
    return Scene(TRIALS, EPOCHS, request.param)


# ----------------------------------------------------------------------------------------------------- FilterPy


def test_filterpy_kalman():
    kalman = pytest.importorskip("filterpy.kalman", reason="FilterPy is in the extra bench")
    rng = np.random.default_rng(2)
    mixing = rng.normal(size=(3, 3))
    r = mixing @ mixing.T + np.eye(3)
    model, motion = Linear(rng.normal(size=(3, 6)), r), WhiteNoiseAcceleration(0.2)
    scene = Scene(TRIALS, EPOCHS)
    scene.model, scene.motion = model, motion
    scene.covariance = np.diag([100.0, 64, 81, 4, 4, 4])
    scene.mean = rng.normal(size=(TRIALS, 6)) * 5
    scene.measurement = rng.normal(size=(EPOCHS, TRIALS, 3)) * 10

    def one(trial):
        kf = kalman.KalmanFilter(dim_x=6, dim_z=3)
        kf.x, kf.P = scene.mean[trial].copy(), scene.covariance.copy()
        kf.F, kf.Q = motion.transition(kf.x, 1.0).copy(), motion.process_noise(kf.x, 1.0).copy()
        kf.H, kf.R = model.jacobian(kf.x, None).copy(), r
        for k in range(EPOCHS):
            if k:
                kf.predict()
            kf.update(scene.measurement[k, trial])
            yield kf.x, kf.P

    expected = over_trials(scene, one)
    for algorithm in (
        IteratedExtendedKalman(1),
        IteratedExtendedKalman(),
        UnscentedKalman(),
        UnscentedKalman(0.5, 2.0),
    ):
        assert_close(ours(algorithm, scene), expected, 1e-10)


def test_filterpy_extended(scene):
    kalman = pytest.importorskip("filterpy.kalman", reason="FilterPy is in the extra bench")

    def one(trial):
        ekf = kalman.ExtendedKalmanFilter(dim_x=6, dim_z=6)
        ekf.x, ekf.P = scene.mean[trial].copy(), scene.covariance.copy()
        ekf.F, ekf.Q = scene.motion.transition(ekf.x, 1.0), scene.motion.process_noise(ekf.x, 1.0)
        ekf.R = scene.model.noise_covariance() * np.outer(METRES, METRES)
        for k in range(EPOCHS):
            if k:
                ekf.predict()
            carriers = scene.platforms[k].reshape(3, 6)
            ekf.update(
                scene.measurement[k, trial] * METRES,
                lambda x, carriers=carriers: METRES[:, None] * scene.model.jacobian(x, carriers),
                lambda x, carriers=carriers: METRES * scene.model.predict(x, carriers),
            )
            yield ekf.x, ekf.P

    # rounding of 7e6 m, and FilterPy's S^-1 with a condition number of 1e6
    assert_close(ours(IteratedExtendedKalman(1), scene), over_trials(scene, one), 1e-7)


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 0.0, 0.0), (0.5, 2.0, 0.0), (1.0, 2.0, -3.0)])
def test_filterpy_unscented(scene, alpha, beta, kappa):
    kalman = pytest.importorskip("filterpy.kalman", reason="FilterPy is in the extra bench")
    phi, q = scene.motion.transition(scene.mean[0], 1.0), scene.motion.process_noise(scene.mean[0], 1.0)

    def one(trial):
        points = kalman.MerweScaledSigmaPoints(6, alpha, beta, kappa)
        ukf = kalman.UnscentedKalmanFilter(6, 6, 1.0, None, lambda x, dt: phi @ x, points)
        ukf.x, ukf.P, ukf.Q = scene.mean[trial].copy(), scene.covariance.copy(), q
        ukf.R = scene.model.noise_covariance() * np.outer(METRES, METRES)
        for k in range(EPOCHS):
            if k:
                ukf.predict()
            else:
                ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)  # it draws them at the end of a prediction only
            carriers = scene.platforms[k].reshape(3, 6)
            ukf.update(
                scene.measurement[k, trial] * METRES,
                hx=lambda x, carriers=carriers: METRES * scene.model.predict(x, carriers),
            )
            yield ukf.x, ukf.P

    # its sums over sigma points cancel where its weights do: 1e-9 of 7e6 m beside a metre
    assert_close(ours(UnscentedKalman(alpha, beta, kappa), scene), over_trials(scene, one), 1e-6)


# ---------------------------------------------------------------------------------------------------- Stone Soup


def stone_soup_run(scene, updater):
    """One of Stone Soup's updaters with an analytic Jacobian, over the scene."""
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.array import CovarianceMatrix, StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.types.state import GaussianState

    class Measured(NonLinearGaussianMeasurement):
        carriers: np.ndarray = Property()

        @property
        def ndim_meas(self):
            return 6

        def function(self, state, noise=False, **kwargs):
            x = np.asarray(state.state_vector, dtype=float)[:, 0]
            return StateVector(METRES * scene.model.predict(x, self.carriers))

        def jacobian(self, state, **kwargs):
            x = np.asarray(state.state_vector, dtype=float)[:, 0]
            return METRES[:, None] * scene.model.jacobian(x, self.carriers)

    moving = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=np.array(scene.motion.transition(scene.mean[0], 1.0)),
        covariance_matrix=CovarianceMatrix(np.array(scene.motion.process_noise(scene.mean[0], 1.0))),
    )
    noise = CovarianceMatrix(scene.model.noise_covariance() * np.outer(METRES, METRES))
    begin = datetime.datetime(2024, 1, 1)

    def one(trial):
        state = GaussianState(StateVector(scene.mean[trial]), CovarianceMatrix(scene.covariance), timestamp=begin)
        for k in range(scene.epochs):
            now = begin + datetime.timedelta(seconds=k)
            if k:
                prediction = KalmanPredictor(moving).predict(state, timestamp=now)
            else:
                prediction = GaussianStatePrediction(state.state_vector, state.covar, timestamp=now)
            model = Measured(
                ndim_state=6,
                mapping=(0, 1, 2, 3, 4, 5),
                noise_covar=noise,
                carriers=scene.platforms[k].reshape(3, 6),
            )
            z = Detection(StateVector(scene.measurement[k, trial] * METRES), timestamp=now, measurement_model=model)
            state = updater().update(SingleHypothesis(prediction, z))
            yield np.asarray(state.state_vector, dtype=float)[:, 0], np.asarray(state.covar, dtype=float)

    return over_trials(scene, one)


def test_stone_soup_extended(scene):
    updaters = pytest.importorskip("stonesoup.updater.kalman", reason="Stone Soup is in the extra bench")
    expected = stone_soup_run(scene, updaters.ExtendedKalmanUpdater)
    # (I - K H) P in the textbook's form there
    assert_close(ours(IteratedExtendedKalman(1), scene), expected, 1e-6)


def test_stone_soup_iterated(scene):
    """Both iterate until a step is shorter than 1e-6: the same fixed point, whatever the way."""
    updaters = pytest.importorskip("stonesoup.updater.kalman", reason="Stone Soup is in the extra bench")
    expected = stone_soup_run(scene, lambda: updaters.IteratedKalmanUpdater(tolerance=1e-6, max_iterations=50))
    iterated = ours(IteratedExtendedKalman(50, 1e-6), scene)
    assert_close(iterated, expected, 1e-6)
    # and that is something else than the extended filter
    extended = ours(IteratedExtendedKalman(1), scene)
    assert np.abs(iterated[0] - extended[0]).max() > 10.0
