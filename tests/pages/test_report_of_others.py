"""Pages of a sweep and of a verification, which have no course of trials."""

import json
import re

import pytest

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.pages.report import report_page

REQUIREMENTS = """
system: three_satellite
trials: 40
trial_limit: 80
cases:
  short: {set: [duration_s=4]}
requirements:
  - {name: "<close>", case: short, estimator: iekf, metric: !Rmse {of: position, time_s: 4}, at_most: 90000}
  - {name: closer, case: short, estimator: iekf, metric: !Rmse {of: position, time_s: 4}, at_most: 1}
"""


def made(arguments, folder, status=0):
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments), "--out", str(folder)])
    assert ended.value.code == status
    page = report_page(folder)
    return page, json.loads(re.search(r'id="numbers">(.*?)</script>', page, re.DOTALL)[1])


def test_a_sweep(tmp_path):
    asked = ["sweep", "three_satellite", "--vary", "truth.sigma_tdoa_ns=10,30", "--estimator", "iekf", "--trials", 4]
    page, told = made([*asked, "--set", "duration_s=4"], tmp_path / "sweep")
    found = json.loads((tmp_path / "sweep" / "sweep.json").read_text())
    assert told["sweep"]["values"] == found["values"] == [10, 30]
    assert told["sweep"]["rows"]["iekf"]["rmse_position_m"] == found["estimators"]["iekf"]["rmse_position_m"]
    assert "At the first point" in page and "sigma_tdoa_ns: 10" in page


def test_a_verification(tmp_path):
    asked = tmp_path / "r.requirements.yaml"
    asked.write_text(REQUIREMENTS)
    page, told = made(["verify", asked], tmp_path / "verify", 1)
    assert [one["verdict"] for one in told["requirements"]] == ["holds", "fails"]
    assert "1 of 2 hold, 1 fail, 0 undecided" in page and "&lt;close&gt;" in page and "<b><close>" not in page
