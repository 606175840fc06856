"""A station found from one-way Doppler of a satellite: the recordings of DopTrack."""

import dataclasses

import numpy as np
import pytest

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.data import data_folder
from quietfix.diagrams.readers.doptrack_data import read_passes, teme_to_earth_fixed
from quietfix.diagrams.recorded.doptrack import ORDERS, SOURCE, Settings, batch_fix, declare_passes
from quietfix.diagrams.recorded.settings.doptrack_settings import Selection
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from tests.fitting import check_fits
from tests.golden.recordings import report_of

BAD = "202004011959"


def replay_passes(passes, settings=None):
    settings = settings or Settings()
    return report_of("doptrack", declare_passes(passes, settings), settings)


@pytest.fixture(scope="module")
def passes(recorded):
    return read_passes(recorded("doptrack_delfic3"))


@pytest.fixture(scope="module")
def found(passes):
    return replay_passes(passes)


def test_true_equator_axes_are_turned():
    """Vallado, Revisiting Spacetrack Report 3 (AIAA 2006-6753), appendix C: TEME to Earth-fixed, without polar motion.

    Epoch 2004 April 6, 07:51:28.386009 UTC; printed with UT1 - UTC = -0.439962 s, which is -32 microradians.
    """
    julian = 2453101.5 + (7 * 3600 + 51 * 60 + 28.386009 - 0.4399619) / 86400
    teme = 1e3 * np.array([5094.18016210, 6127.64465950, 6380.34453270])
    speed = 1e3 * np.array([-4.746131487, 0.785818041, 5.531931288])
    state = teme_to_earth_fixed(teme, speed, np.array(julian))
    # pseudo-Earth-fixed in print; a double Julian date resolves 40 microseconds: 0.02 m here
    np.testing.assert_allclose(state[:3], [-1033475.0312, 7901305.5856, 6380344.5327], atol=0.1)
    np.testing.assert_allclose(state[3:], [-3225.632747, -2872.442511, 5531.931288], atol=1e-3)


def test_velocity_is_the_derivative_of_the_place():
    place, step = np.array([7e6, 1e5, -2e5]), 0.5
    states = [
        teme_to_earth_fixed(place + speed * s, speed, np.array(2458940.5 + s / 86400))
        for speed in [np.array([100.0, 7e3, 1e3])]
        for s in (-step, 0.0, step)
    ]
    slope = (states[2] - states[0])[:3] / (2 * step)
    # a Julian date resolves 40 us, 0.3 m of 7 km/s
    np.testing.assert_allclose(slope, states[1][3:], atol=1.0)
    assert EARTH_RATE * 7e6 > 500.0  # which is what forgetting the rotation would cost


def test_the_rule_takes_most_passes_and_names_no_one(passes):
    rule = Selection()
    taken = [one.name for one in passes if rule.takes(one)]
    assert len(passes) == 44 and len(taken) == 30 and BAD not in taken
    one = next(one for one in passes if one.name == BAD)
    assert Selection(always=[BAD]).takes(one)


@pytest.mark.slow
def test_the_station_is_found(found):
    """Starting 200 km off."""
    errors = {name: found.horizontal_error(name) for name in ORDERS}
    print(errors, {name: found.robust_sigma(name) for name in ORDERS})
    assert np.hypot(*found.errors("bias_drift")[0, :2]) > 100e3
    assert errors["bias_drift"] <= 5e3
    assert errors["bias"] >= 2 * errors["bias_drift"]
    assert errors["bias_drift_rate"] <= 5e3
    assert found.robust_sigma("bias_drift") <= 20.0
    assert found.robust_sigma("bias") > 150.0
    assert abs(found.errors("bias_drift")[-1, 2]) < 1e3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bias_drift", "bias_drift_rate"])
def test_least_squares_over_all_passes_agrees(passes, found, name):
    batch = batch_fix(passes, ORDERS[name])
    print(name, np.linalg.norm(batch - found.estimates[name][-1]))
    assert np.linalg.norm(batch - found.estimates[name][-1]) < 1e3


@pytest.mark.slow
def test_the_bad_pass_does_not_move_the_answer(passes, found):
    with_it = replay_passes(passes, Settings(selection=Selection(always=[BAD])))
    assert BAD in with_it.summary()["passes"]
    moved = {n: np.linalg.norm(with_it.estimates[n][-1] - found.estimates[n][-1]) for n in ORDERS}
    print("moved by", moved)
    assert moved["bias_drift"] < 500.0 and moved["bias_drift_rate"] < 500.0


def test_a_few_passes_are_replayed_from_the_command(recorded, monkeypatch, capsys):
    import quietfix.diagrams.recorded.doptrack as doptrack

    folder = recorded("doptrack_delfic3")
    monkeypatch.setattr(doptrack, "read_passes", lambda path: read_passes(path)[4:10])
    result = replay("doptrack", data=folder, progress=False)
    summary = result.summary()
    assert set(summary["estimators"]) == set(ORDERS)
    assert summary["estimators"]["bias_drift"]["horizontal_error_m"] < 50e3  # from 200 km, four passes
    check_fits(result.table())
    assert "bias_drift" in capsys.readouterr().out
    assert abs(ecef_to_geodetic(result.estimates["bias_drift"][-1])[2] - 95.0) < 3e3


def test_what_is_refused(passes, tmp_path):
    with pytest.raises(UserError, match="takes no pass"):
        replay_passes(passes, Settings(selection=Selection(elevation_deg=91.0)))
    with pytest.raises(UserError, match="no passes"):
        read_passes(tmp_path)
    (tmp_path / "Delfi-C3_1.yml").write_text("tracking: {}\n")
    with pytest.raises(UserError, match="cannot be read"):
        read_passes(tmp_path)
    with pytest.raises(UserError, match="TU Delft"):
        data_folder(SOURCE, tmp_path / "nowhere")


def _copied(folder, to, count=1):
    """Copy the first passes; return their metadata."""
    files = sorted(folder.glob("Delfi-C3_*.yml"))[:count]
    for file in files:
        for one in (file, file.with_suffix(".csv")):
            (to / one.name).write_bytes(one.read_bytes())
    return [to / file.name for file in files]


@pytest.mark.parametrize(
    "epoch",
    [
        "2020-04-01 10:44:03.290241+02:00",
        "'2020-04-01T10:44:03.290241+02:00'",
        "2020-04-01T08:44:03.290241Z",
        "2020-04-01 03:14:03.290241 -05:30",
    ],
)
def test_an_epoch_with_an_offset_is_honoured(recorded, tmp_path, epoch):
    """The same instant as the recording's own naive epoch, which is UTC: the same start and satellite."""
    folder = recorded("doptrack_delfic3")
    (meta,) = _copied(folder, tmp_path)
    (naive,) = read_passes(tmp_path)
    meta.write_text(meta.read_text().replace("epoch: 2020-04-01 08:44:03.290241", f"epoch: {epoch}"))
    assert epoch in meta.read_text()
    (one,) = read_passes(tmp_path)
    # a Julian date is a double: 40 us
    assert one.start == pytest.approx(naive.start, abs=1e-9)
    np.testing.assert_allclose(one.satellite, naive.satellite, rtol=1e-9)


def test_files_that_cannot_belong_together_are_refused(recorded, tmp_path):
    metas = _copied(recorded("doptrack_delfic3"), tmp_path, 2)
    text = metas[1].read_text()
    metas[1].write_text(text.replace("longitude: 4.37", "longitude: 5.37"))
    with pytest.raises(UserError, match="another station"):
        read_passes(tmp_path)
    metas[1].write_text(text.replace("epoch: 2020-04-01 10:19:03.539592", "epoch: 2020-04-01"))
    with pytest.raises(UserError, match="'2020-04-01' is not allowed; a date with a time of day"):
        read_passes(tmp_path)
    metas[1].unlink()
    with pytest.raises(UserError, match=r"ends in .yml"):
        read_passes(tmp_path)


def test_an_oscillator_outside_its_prior_is_told(passes):
    """20 km/s on one pass, where the prior has 2 km/s: told with ten sigmas; without it nothing is (1.2 at most)."""
    few = passes[4:10]
    clean = replay_passes(few)
    assert not clean.outside_prior and not any("prior" in line for line in clean.notes())
    which = next(i for i, one in enumerate(few) if Selection().takes(one))
    wrong = [dataclasses.replace(one, range_rate=one.range_rate + 20e3 * (i == which)) for i, one in enumerate(few)]
    found = replay_passes(wrong)
    assert set(found.outside_prior) == set(ORDERS)
    for far in found.outside_prior.values():
        assert len(far) == 1 and abs(far[0][0] - 10.0) < 1.5  # its own bias is 1.2 sigmas at most
    said = [line for line in found.notes() if "outside of its prior" in line]
    assert len(said) == len(ORDERS) and f"pass {few[which].name}: bias" in said[0] and "sigmas" in said[0]
    assert few[which].name in found.summary()["estimators"]["bias"]["outside_prior"][0]
