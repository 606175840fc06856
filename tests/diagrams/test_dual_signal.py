"""From I/Q samples to a track: errors as predicted, ambiguous pulses, outliers below the threshold."""

from functools import lru_cache

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.library.models.dual_satellite import models
from quietfix.diagrams.parts.dual_signal import QUALITY, predicted_sigmas
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from quietfix.systems.ambiguity.differences import Flag
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.constant_velocity import ConstantVelocity

SHORT = {"sensing.samples": 16384, "sensing.snr_main_db": -6.0, "sensing.snr_auxiliary_db": -6.0}


def study(variant, trials, estimators=("iekf",), first_trial=0, seed=0, **settings):
    given = {key.replace("__", "."): value for key, value in settings.items()}
    return run_study(
        "dual_satellite",
        variant=variant,
        estimators=list(estimators),
        trials=trials,
        first_trial=first_trial,
        seed=seed,
        set=given,
        keep="all",
    )


def errors(result, **settings):
    """Return the errors of TDOA and FDOA and their predicted standard deviations, each (trial, time, 2).

    Exact is what the models say of one wave front; gravity between the two arrivals is not in them, 0.01 Hz.
    """
    changes = [f"{key}={value}" for key, value in settings.items()]
    believed = models(load_scenario("dual_satellite", result.attrs["variant"], settings=changes), believed=True)
    truth, platforms = result["truth"].values, result["platforms"].values
    exact = np.stack([believed[kind].predict(truth, platforms)[..., 0] for kind in ("tdoa", "fdoa")], axis=-1)
    variance = result["differences_covariance"].values[..., [0, 3]]
    return result["measurement"].values[..., 2:] - exact, np.sqrt(variance)


# ------------------------------------------------------------------------------------------ fast: is it all there


def test_the_diagram_shows_the_units_of_the_patent():
    diagram, wired = Study("dual_satellite:signal").diagram()
    names = {block.get_name() for block in diagram.GetSystems()}
    assert names >= {
        "emitter",
        "transmitter",
        "main_receiver",
        "auxiliary_receiver",
        "inter_satellite_link",
        "direction_finding",
        "cross_ambiguity",
        "search_window",
        "measurements",
    }
    assert wired.dashed == [("iekf", "search_window")]
    assert wired.model.widest == 30
    assert wired.note.startswith("SNR -12 and -12 dB in the sample rate of 4 MHz leave 10.3 ns of TDOA and 1.2 Hz")
    # what is on the main satellite and no sensor knows the emitter by its signal only
    for (target, _), (source, _) in diagram.connection_map().items():
        if target.get_name() in ("search_window", "cross_ambiguity", "measurements", "inter_satellite_link"):
            assert source.get_name() not in ("emitter", "transmitter")


@lru_cache
def _short():
    return study("signal", 3, duration_s=6.0, **SHORT)


def test_measurements_are_as_good_as_predicted():
    """A quarter of the samples at 6 dB more, nearly the same errors; 12 of each: 4 sigma of their std is 0.8."""
    error, sigma = errors(_short(), **SHORT)
    assert np.isfinite(error).all()
    normalised = error / sigma
    assert normalised.std(axis=(0, 1)).min() > 0.4 and normalised.std(axis=(0, 1)).max() < 1.8
    assert np.abs(normalised).max() < 4.5
    scenario = load_scenario("dual_satellite", "signal", settings=[f"{k}={v}" for k, v in SHORT.items()])
    np.testing.assert_allclose(np.median(sigma, axis=(0, 1)), predicted_sigmas(scenario.sensing), rtol=0.1)


def test_one_bit_on_the_link_is_in_what_is_predicted():
    """Note, bound and samples agree on it: 1.25 times in both; 12 measurements know it to some percent."""
    coarse = {**SHORT, "sensing.link_bits": 1}
    result = study("signal", 3, duration_s=6.0, **coarse)
    _, sigma = errors(result, **coarse)
    one, eight = (
        load_scenario("dual_satellite", "signal", settings=[f"{k}={v}" for k, v in changes.items()]).sensing
        for changes in (coarse, SHORT)
    )
    np.testing.assert_allclose(np.median(sigma, axis=(0, 1)), predicted_sigmas(one), rtol=0.1)
    ratio = np.array(predicted_sigmas(one)) / predicted_sigmas(eight)
    np.testing.assert_allclose(ratio, np.sqrt(np.pi / 2), rtol=0.02)
    assert f"leave {1e9 * predicted_sigmas(one)[0]:.3g} ns" in result.attrs["note"]
    growth = (result["bound_position"] / _short()["bound_position"]).values
    # at the beginning the direction, which the link does not touch, decides
    assert np.all(growth > 1.0) and np.all(growth < 1.26) and growth[..., -1].min() > 1.001


def test_both_bounds_and_the_consistency_are_there():
    result = _short()
    for kind in ("bound_position", "bound_truth_position", "bound_velocity", "bound_truth_velocity"):
        assert np.isfinite(result[kind]).all()
    # the truth flies straight: without process noise the bound is lower
    assert (result["bound_truth_position"] <= result["bound_position"] * (1 + 1e-9)).all()
    assert (result["nis_dof"] == 4).all()
    assert 0.3 < float(result["nis"].sum() / result["nis_dof"].sum()) < 2.0  # 48 degrees of freedom


def test_a_trial_alone_is_a_trial_of_a_batch():
    """The window follows the estimator, which agrees to its stop tolerance; so do the measurements."""
    alone = study("signal", 1, first_trial=2, duration_s=6.0, **SHORT)
    for name, unit in (("measurement", [1e-3, 1e-3, 1e-12, 1e-4]), ("estimate", [1e-2] * 3 + [1e-3] * 3)):
        difference = alone[name].values[..., 0, :, :] - _short()[name].values[..., 2, :, :]
        assert np.all(np.abs(difference) < unit)


def test_without_noise_nothing_is_left_but_the_signals_own():
    strong = {"sensing.snr_main_db": 90.0, "sensing.snr_auxiliary_db": 90.0, "sensing.link_bits": 0}
    result = study("signal", 1, duration_s=4.0, **strong)
    error, _ = errors(result, **strong)
    # what is compared are two cuts of one signal: their ends leave a hundredth of a nanosecond and of a hertz; gravity,
    # see `errors`, does as much
    assert np.abs(error[..., 0]).max() < 0.1e-9
    assert np.abs(error[..., 1]).max() < 0.02


def test_what_is_not_known_of_the_link_is_an_error_of_the_delay():
    strong = {"sensing.snr_main_db": 30.0, "sensing.snr_auxiliary_db": 30.0, "sensing.samples": 16384}
    late = {"sensing.link_delay_error_ns": 50.0}
    first, second = (study("signal", 1, duration_s=2.0, **strong, **more) for more in ({}, late))
    shift = (second["measurement"] - first["measurement"]).values[0, 0]
    assert shift[2] == pytest.approx(50e-9, abs=0.1e-9)
    assert shift[3] == pytest.approx(0.0, abs=1e-2)


def test_it_starts_from_its_own_first_measurement():
    """No prior: the direction says where to search, and direction, TDOA, FDOA and a height are the start."""
    result = study("signal", 2, duration_s=6.0, **SHORT, **{"belief.start": "measurement"})
    assert np.isfinite(result["estimate"]).all()
    assert (result["nees"] < 40).all()


@pytest.mark.parametrize(
    "settings",
    [
        {"sensing.waveform": "!BandLimitedNoise {}", "sensing.window": "direction"},
        {"truth.motion": "!RandomAcceleration {sigma_velocity_mps: 200}", "sensing.link_bits": 1},
        {"sensing.prefilter": "none", "truth.direction": "cosines", "truth.motion": "!GreatCircle {}"},
    ],
    ids=lambda settings: ", ".join(settings),
)
def test_options_work(settings):
    """TDOA and FDOA are there, none further off than five of their predicted standard deviations (16 numbers)."""
    given = {**SHORT, **settings}
    result = study("signal", 2, duration_s=6.0, **given)
    exact = models(load_scenario("dual_satellite", "signal"), believed=True)
    truth, platforms = result["truth"].values, result["platforms"].values
    error = np.stack([exact[kind].predict(truth, platforms)[..., 0] for kind in ("tdoa", "fdoa")], axis=-1)
    error = result["measurement"].values[..., 2:] - error
    normalised = error / np.sqrt(result["differences_covariance"].values[..., [0, 3]])
    assert np.isfinite(normalised).all() and np.abs(normalised).max() < 5.0
    assert np.isfinite(result["estimate"]).all()


def test_a_receiver_below_the_horizon_leaves_the_direction():
    hidden = {"truth.minimum_elevation_deg": 39.4}  # the auxiliary satellite is lower than the main one
    result = study("signal", 1, duration_s=4.0, **SHORT, **hidden)
    rows = np.isfinite(result["measurement"].values[0])
    assert rows[:, :2].any() and not rows[:, 2:].any()
    assert np.isfinite(result["estimate"]).all() and np.isfinite(result["bound_position"]).all()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"sensing.samples": 2**20}, "sensing.samples: 1048576 is not allowed; integration time"),
        ({"sensing.sample_rate_mhz": 2.0}, "sensing.sample_rate_mhz: 2 is not allowed; at least the waveform's band"),
        ({"sensing.window_largest_hz": 20.0}, "sensing.window_largest_hz: 20 is not allowed"),
        ({"sensing.window": "nadir"}, "sensing.window: 'nadir' is not allowed"),
        ({"sensing.waveform": "!PulseTrain {width_us: 2000}"}, "width: 0.002 s is not allowed"),
        ({"sensing.waveform": "!Chirp {}"}, "!Qpsk"),
        ({"sensing.link_bits": 40}, "sensing.link_bits: 40 is not allowed"),
    ],
)
def test_what_is_wrong_is_said(setting, words):
    with pytest.raises(UserError, match=words.replace("(", r"\(")):
        study("signal", 1, duration_s=2.0, **setting)


# --------------------------------------------------------------------------------------------- ambiguous pulses


WIDE = {"sensing.window": "direction", "sensing.window_largest_hz": 2600.0, "sensing.window_sigmas": 20.0}


def test_pulses_need_a_window_from_the_prediction():
    """A peak every kilohertz: the predicted window has the right one in all epochs, a wide one has it by chance.

    Of five lines in +-2600 Hz, or more, all but equally high behind noise, the right one wins in a fifth to a half.
    """
    good, _ = errors(study("pulse_train", 3, duration_s=8.0))
    assert np.isfinite(good).all()
    assert np.abs(good[..., 1]).max() < 3.0  # 0.5 Hz
    lost, _ = errors(study("pulse_train", 3, duration_s=8.0, **WIDE))
    seen = lost[np.isfinite(lost).all(axis=-1)]
    lines = np.round(seen[:, 1] / 1000.0)
    assert len(seen) >= 12 and np.mean(lines == 0) < 0.6
    # wrong by whole pulse rates, and the delay, for which all lines are alike, stays right
    assert np.abs(seen[:, 1] - 1000.0 * lines).max() < 50.0
    assert np.abs(seen[:, 0]).max() < 1e-6


# ------------------------------------------------------------------------------------------ below the threshold


def _outliers(result, settings):
    error, sigma = errors(result, **settings)
    return int((np.abs(error / sigma) > 6).any(axis=-1).sum())


def test_the_gate_takes_outliers_out():
    """A quarter of the samples at 3 dB more leaves the peak as high over the noise, and is faster."""
    quarter = {"sensing.samples": 16384, "sensing.snr_main_db": -17.0, "sensing.snr_auxiliary_db": -17.0}
    runs = {gate: study("low_snr", 6, duration_s=14.0, **quarter, **{"sensing.gate": gate}) for gate in (False, True)}
    open_, closed = runs[False], runs[True]
    passed = np.isfinite(closed["measurement"].values[..., 2])
    assert _outliers(open_, quarter) >= 5  # of 48
    assert _outliers(closed, quarter) == 0  # one in 10,000 windows is expected
    assert 0.02 < passed.mean() < 0.8
    # direction finding goes on, and a gated row is missing for the bounds too
    assert np.isfinite(closed["measurement"].values[..., :2]).all()
    assert (closed["bound_position"].values[0, -1] > open_["bound_position"].values[0, -1]).all()
    flags = closed["quality"].values[..., QUALITY.index("flag")].astype(int)
    np.testing.assert_array_equal(flags == Flag.GOOD, passed)
    assert np.all(flags[~passed] & Flag.BELOW_THRESHOLD)


@pytest.mark.slow
def test_below_the_threshold_the_gate_saves_the_track():
    """8 trials, 100 s. The survivors of the gate are the strong ones: their predicted errors are a bit small."""
    closed, open_ = (study("low_snr", 8, duration_s=100.0, **{"sensing.gate": gate}) for gate in (True, False))
    squares = [np.square((run["estimate"] - run["truth"]).values[0, :, -1, :3]).sum(axis=-1) for run in (closed, open_)]
    rmse = [np.sqrt(square.mean()) for square in squares]
    assert rmse[0] < 1.5 * float(closed["bound_position"][0, -1])
    assert rmse[1] > 20e3
    assert 2.5 < float(closed["nees"].values[0, :, -1].mean()) < 12.0  # 48 degrees of freedom, and the above


# ------------------------------------------------------------- the track on samples and on the same errors, drawn


def _track(result, model, measurement):
    """Filter measurement-level rows (trial, time, 4) from the study's own starts; return estimates (trial, time, 6)."""
    algorithm, motion = IteratedExtendedKalman(10, 1e-2), ConstantVelocity(0.1)
    mean = result["prediction"].values[0, :, 0]
    covariance = np.broadcast_to(np.diag([5e3**2] * 3 + [200.0**2] * 3), (mean.shape[0], 6, 6))
    times, platforms = result["time"].values, result["platforms"].values
    whitener = Whitener(model.noise_covariance())
    estimates = []
    for k, time in enumerate(times):
        if k > 0:
            mean, covariance = algorithm.predict(mean, covariance, motion, time - times[k - 1])
        found = algorithm.update(
            mean, covariance, Observation(measurement[:, k], platforms[k : k + 1], whitener), model
        )
        mean, covariance = found.mean, found.covariance
        estimates.append(mean)
    return np.stack(estimates, axis=1)


def _compare(result, scenario):
    """Return normalised errors, and the position RMSE of the track on samples and of that on drawn measurements.

    The drawn ones have the same normalised errors, scaled by the standard deviations that theory gives.
    """
    believed = models(scenario, believed=True)
    model = Stack([believed[kind] for kind in ("direction", "tdoa", "fdoa")])
    exact = model.predict(result["truth"].values, result["platforms"].values)
    measured = result["measurement"].values
    error = measured[..., 2:] - exact[..., 2:]
    normalised = error / np.sqrt(result["differences_covariance"].values[..., [0, 3]])
    drawn = measured.copy()
    drawn[..., 2:] = exact[..., 2:] + normalised * np.array(predicted_sigmas(scenario.sensing))
    tracks = result["estimate"].values[0], _track(result, model, drawn)
    squares = [np.square(track - result["truth"].values)[..., :3].sum(axis=-1) for track in tracks]
    return normalised, *(np.sqrt(square.mean(axis=0)) for square in squares)


def test_the_track_is_that_on_measurements_with_the_same_errors():
    """The statement of the slow test at a quarter of the samples: four epochs, three trials."""
    scenario = load_scenario("dual_satellite", "signal", settings=[f"{k}={v}" for k, v in SHORT.items()])
    _, on_samples, on_drawn = _compare(_short(), scenario)
    np.testing.assert_allclose(on_samples, on_drawn, rtol=0.1)


@pytest.mark.slow
def test_signal_at_full_size():
    """20 trials of 60 s at 2 s, 620 cross-ambiguity functions of 65,536 samples.

    Their normalised errors have a standard deviation known to 2.8 %, so that 0.9 to 1.1 is 3.5 sigma.
    """
    result = study("signal", 20, duration_s=60.0)
    scenario = load_scenario("dual_satellite", "signal")
    normalised, on_samples, on_drawn = _compare(result, scenario)
    assert np.isfinite(normalised).all()
    spread = normalised.std(axis=(0, 1))
    assert np.all((spread > 0.9) & (spread < 1.1))
    assert np.all(np.abs(normalised.mean(axis=(0, 1))) < 4 / np.sqrt(620))
    np.testing.assert_allclose(on_samples, on_drawn, rtol=0.1)
    assert 0.8 < on_samples[-1] / float(result["bound_position"][0, -1]) < 1.2  # 20 trials: 8 %
    assert 4.0 < float(result["nees"].mean()) < 8.0
