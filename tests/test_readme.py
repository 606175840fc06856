"""Every Python block of the README runs as it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]
BLOCKS = re.findall(r"```python\n(.*?)```", (PROJECT / "README.md").read_text(encoding="utf-8"), re.DOTALL)


def run(code, folder):
    environment = os.environ | {"PYTHONPATH": f"{PROJECT}{os.pathsep}{folder}"}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_block_runs(number, tmp_path):
    done = run(BLOCKS[number], tmp_path)
    assert done.returncode == 0, done.stderr


def test_users_filter_from_the_readme_takes_part(tmp_path):
    (block,) = [block for block in BLOCKS if block.startswith("# my_filters.py")]
    (tmp_path / "my_filters.py").write_text(block)
    code = (
        "from diagrams import run_study\n"
        "r = run_study('three_satellite', estimators=['iekf', 'my_filters:Gated'], trials=3, set=['duration_s=5'])\n"
        "s = run_study('three_satellite', estimators=['mine'], trials=3, set=["
        "'duration_s=5', 'estimators.mine=!Custom {class: \"my_filters:Gated\", options: {gate: 0.0}}'])\n"
        "assert (r['estimate'].sel(estimator='gated') == r['estimate'].sel(estimator='iekf')).all()\n"
        "assert (s['estimate'].values[0, :, -1] != r['estimate'].values[0, :, -1]).any()\n"
    )
    done = run(code, tmp_path)
    assert done.returncode == 0, done.stderr
