"""Settings of the replays of recordings: told, changed, refused; folders of any name."""

import shutil

import pytest
from typer.testing import CliRunner

from quietfix.diagrams.commands.command_line import app
from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.data import data_folder
from quietfix.diagrams.recorded.doptrack import SOURCE as DOPTRACK
from quietfix.diagrams.recorded.locards import SOURCE as LOCARDS
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.recordings import recording_settings


@pytest.mark.parametrize(
    ("dataset", "setting", "shown"),
    [
        ("locards", "sigma_tdoa_m=40", "sigma_tdoa_m: 40.0  # standard deviation of a time difference"),
        ("doptrack", "selection.elevation_deg=30", "  elevation_deg: 30.0  # least predicted largest elevation"),
        ("kiwisdr", "integration_s=2", "integration_s: 2.0  # of one comparison"),
        ("iq", "every_s=0.5", "every_s: 0.5  # time from one comparison to the next"),
    ],
)
def test_settings_are_shown_with_their_meaning(dataset, setting, shown):
    field = setting.rpartition("=")[0].rpartition(".")[2]
    told = CliRunner().invoke(app, ["show", dataset, "--set", setting])
    assert told.exit_code == 0 and shown in told.output
    helped = CliRunner().invoke(app, ["replay", dataset, "--help"])
    assert helped.exit_code == 0 and f"{field}: " in helped.output
    shown = recording_settings(dataset)
    assert all("  # " in line for line in shown.splitlines() if not line.startswith("  ") or "elevation" in line)


@pytest.mark.parametrize(
    ("dataset", "setting", "message"),
    [
        ("locards", "sigma_m=40", "sigma_m is not known.*; .*sigma_tdoa_m.*fault_m"),
        ("locards", "false_alarm=0", "false_alarm: 0 is not allowed; a finite number > 0"),
        ("locards", "air=3", "air: 3 is not allowed; true or false"),
        (
            "doptrack",
            "selection.elevation=3",
            "elevation is not known.*; there are elevation_deg, span_s, samples, always",
        ),
        ("doptrack", "sigma_mps=[1, 2]", "sigma_mps: .* is not allowed; three numbers > 0"),
        ("kiwisdr", "notch=1", "notch is not known.*notch_hz"),
        ("kiwisdr", "half_delay_s=-1", "half_delay_s: -1 is not allowed; a finite number >= 0"),
        ("bearings", "sigma=1", "sigma is not known; there are data, .*estimators"),
    ],
)
def test_a_wrong_setting_is_one_line_before_anything_is_read(dataset, setting, message, tmp_path):
    with pytest.raises(UserError, match=message) as caught:
        replay(dataset, data=tmp_path / "nowhere", settings=[setting], progress=False)
    assert "\n" not in str(caught.value)


def test_a_setting_reaches_the_replay(recorded):
    everything, few = (
        replay("doptrack", data=recorded("doptrack_delfic3"), settings=s, progress=False)
        for s in (["every_s=100"], ["every_s=100", "selection.elevation_deg=60"])
    )
    assert 0 < few.summary()["samples"] < everything.summary()["samples"]


def test_a_folder_that_is_named_may_have_any_name(recorded, tmp_path):
    own = tmp_path / "mine"
    own.mkdir()
    with pytest.raises(UserError, match="mine/locards_mlat is not a folder"):
        data_folder(LOCARDS, own)
    shutil.copy(recorded("locards_mlat_unseen") / "set_5.csv", own)
    assert data_folder(LOCARDS, own) == own
    with pytest.raises(UserError, match="mine/doptrack_delfic3 is not a folder"):
        data_folder(DOPTRACK, own)
