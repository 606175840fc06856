"""A user's own measurement with compiled equations in a system of YAML: as in NumPy, and one line where it is wrong."""

import re
import sys

import numpy as np
import pytest

from quietfix.diagrams import run_study
from tests.diagrams.test_command_line import in_process

MODULE = '''
import numpy as np
from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.equations import of_kernel
from quietfix.systems.measurement.base import MeasurementModel


@kernel
def squared(state, platforms, parameters, value, jacobian):
    for i in range(value.shape[0]):
        for axis in range(3):
            away = state[axis] - platforms[i, axis]
            value[i] += away * away / parameters[0]
            if jacobian.shape[0] > 0:
                jacobian[i, axis] = 2 * away / parameters[0]


class Plain(MeasurementModel):
    """Squared distances to the platforms, in km^2."""

    names, units = ("a", "b", "c", "d"), ("km2",) * 4

    def predict(self, target, platforms):
        return np.square(target[..., None, :3] - platforms[..., :3]).sum(axis=-1) / 1e6

    def jacobian(self, target, platforms):
        lead = np.broadcast_shapes(target.shape[:-1], platforms.shape[:-2])
        out = np.zeros((*lead, 4, target.shape[-1]))
        out[..., :3] = 2 * (target[..., None, :3] - platforms[..., :3]) / 1e6
        return out

    def noise_covariance(self):
        return np.eye(4)


class Compiled(Plain):
    def equations(self):
        return of_kernel(squared, [1e6], rows=4, states=3, platforms=range(4))


class Sometimes(Plain):
    """No number beyond a meridian: in NumPy and in the kernel."""

    limit = 5e3

    def predict(self, target, platforms):
        far = (target[..., 0] > self.limit)[..., None]
        return np.where(far, np.nan, super().predict(target, platforms))

    def equations(self):
        return of_kernel(sometimes, [1e6, self.limit], rows=4, states=3, platforms=range(4))


@kernel
def sometimes(state, platforms, parameters, value, jacobian):
    for i in range(4):
        for axis in range(3):
            away = state[axis] - platforms[i, axis]
            value[i] += away * away / parameters[0]
            if jacobian.shape[0] > 0:
                jacobian[i, axis] = 2 * away / parameters[0]
        if state[0] > parameters[1]:
            value[i] = np.nan


def four(state, platforms, parameters, value):
    value[0] = 0.0


class Wrong(Plain):
    def equations(self):
        return of_kernel(four, [], rows=4, states=3, platforms=range(4))


@kernel
def raises(state, platforms, parameters, value, jacobian):
    raise ValueError("never mind")


class Raises(Plain):
    def equations(self):
        return of_kernel(raises, [], rows=4, states=3, platforms=range(4))


@kernel
def beyond(state, platforms, parameters, value, jacobian):
    for i in range(9):
        value[i] = state[0]


class Beyond(Plain):
    def equations(self):
        return of_kernel(beyond, [], rows=4, states=3, platforms=range(4))


@kernel
def unknown(state, platforms, parameters, value, jacobian):
    value[0] = no_such_thing(state)


class Unknown(Plain):
    def equations(self):
        return of_kernel(unknown, [], rows=4, states=3, platforms=range(4))


class Other(Plain):
    def equations(self):
        return of_kernel(squared, [2e6], rows=4, states=3, platforms=range(4))


@kernel
def flat(state, platforms, parameters, value, jacobian):
    for i in range(4):
        for axis in range(3):
            value[i] += (state[axis] - platforms[i, axis]) ** 2 / 1e6


class Flat(Plain):
    def equations(self):
        return of_kernel(flat, [], rows=4, states=3, platforms=range(4))


class Three(Plain):
    def equations(self):
        return of_kernel(squared, [1e6], rows=3, states=3, platforms=range(4))


class Nothing(Plain):
    def equations(self):
        return 7


class Fails(Plain):
    def equations(self):
        raise KeyError("mine")
'''

SYSTEM = """
duration_s: 5
platforms:
  a: !Fixed {east_km: -8, north_km: -5}
  b: !Fixed {east_km: 9, north_km: -4}
  c: !Fixed {east_km: 1, north_km: 9}
  d: !Fixed {up_m: 300}
target: !Straight {position_km: [-2, 3, 1], velocity_mps: [40, 10, 0]}
sensors:
  mine: !Custom {class: own_kernels:Plain}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 0.1}}
start: !Prior {sigma_position_m: 500, sigma_velocity_mps: 20}
estimators:
  iekf: !Iekf {}
  ukf: !Ukf {}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    (tmp_path / "own_kernels.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("own_kernels", None)


def test_the_site_shows_this_kernel(project_root):
    text = (project_root / "docs" / "tasks" / "custom.md").read_text(encoding="utf-8")
    shown = re.search(r"(@kernel\ndef squared.*?)\n\n\nclass .*?def equations.*?\n +(return.*?)\n```", text, re.DOTALL)
    assert shown and shown[1] in MODULE and shown[2] in MODULE


def written(folder, kind):
    path = folder / f"{kind}.yaml"
    path.write_text(SYSTEM.replace("Plain", kind), encoding="utf-8")
    return path


def test_it_is_the_model_in_numpy(folder):
    plain, compiled = (run_study(str(written(folder, kind)), trials=3, keep="all") for kind in ("Plain", "Compiled"))
    assert np.isfinite(plain["estimate"]).all()
    # two orders of summation, five updates; a step of the iekf ends at 1 cm, both take the same number
    np.testing.assert_allclose(compiled["estimate"], plain["estimate"], rtol=1e-7, atol=1e-6)


def test_no_number_in_one_trial_harms_no_other(folder):
    """Where the target of one trial is believed beyond the meridian its rows are missing; all others keep every bit.

    Not the ukf: sigma points of every trial are beyond.
    """
    path = written(folder, "Sometimes")
    whole = run_study(str(written(folder, "Compiled")), trials=6, keep="all", estimators=["iekf"])
    begin = np.sort(whole["prediction"].values[0, :, 0, 0])
    limit = 0.5 * (begin[-1] + begin[-2])  # passed by one trial alone when it starts
    module = folder / "own_kernels.py"
    module.write_text(MODULE.replace("limit = 5e3", f"limit = {limit!r}"), encoding="utf-8")
    sys.modules.pop("own_kernels", None)
    some = run_study(str(path), trials=6, keep="all", estimators=["iekf"])
    lost = np.flatnonzero((some["nis_dof"] < whole["nis_dof"]).any(("estimator", "time")).values)
    assert len(lost) == 1
    kept = [k for k in range(6) if k not in lost]
    for name in ("estimate", "covariance", "nis"):
        np.testing.assert_array_equal(some[name].values[:, kept], whole[name].values[:, kept])


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("Wrong", r"kernel: four\(state, platforms, parameters, value\) is not allowed; its arguments must be"),
        ("Raises", r"kernel raises: for a target at .*ValueError: never mind"),
        ("Beyond", r"kernel beyond: for a target at .*IndexError"),
        ("Unknown", r"kernel: unknown cannot be compiled: .*no_such_thing"),
        ("Other", r"its kernel is .* sigmas off what predict gives"),
        ("Flat", r"its kernel's derivatives are 1 of the gradient off jacobian"),
        ("Three", r"equations: 3 rows are not allowed; 4, its names"),
        ("Nothing", r"equations: 7 is not allowed; what of_kernel returns, or None"),
        ("Fails", r"equations failed with KeyError: 'mine' \(own_kernels.py, line"),
    ],
)
def test_what_is_wrong_is_one_line(folder, capsys, kind, said):
    status, out, err = in_process(capsys, "run", str(written(folder, kind)), "--trials", "2")
    assert status == 2 and not out and err.startswith("quietfix: ") and err.count("\n") == 1, err
    assert re.search(said, err) and "Traceback" not in err and f"own_kernels:{kind}" in err, err
