"""Nothing escapes the laws: every model, filter and estimator that exists is listed in `tests.laws.cases`."""

import importlib
import inspect
import pkgutil

import pytest

import quietfix.systems
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.registry import ESTIMATORS
from tests.laws.cases import BEARINGS_ONLY, FILTERS, MEASUREMENTS, MOTIONS, OWN_SENSOR, SAMPLED, estimators
from tests.laws.rig import make


def classes(package, base):
    """Every public concrete subclass of `base` in the modules of `package`."""
    found = set()
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        for name, kind in inspect.getmembers(importlib.import_module(info.name), inspect.isclass):
            if issubclass(kind, base) and not inspect.isabstract(kind) and not name.startswith("_"):
                found.add(kind)
    return found


def parts(model):
    """A stack and what is in it."""
    return {type(model)}.union(*(parts(part) for part in model.models)) if isinstance(model, Stack) else {type(model)}


@pytest.mark.parametrize(
    ("package", "base", "listed"),
    [
        (quietfix.systems, MeasurementModel, set().union(*(parts(model) for model, _ in MEASUREMENTS.values()))),
        (quietfix.systems, MotionModel, {type(model) for model, _ in MOTIONS.values()}),
        (quietfix.systems, GaussianFilter, {type(algorithm) for algorithm in FILTERS.values()}),
    ],
    ids=["measurement", "motion", "filters"],
)
def test_every_class_is_listed(package, base, listed):
    found = classes(package, base)
    assert found, "nothing found: the walk is broken"
    # options that inherit the update of a filter add no mathematics
    known = {kind.update for kind in listed if issubclass(kind, GaussianFilter)}
    missing = sorted(kind.__name__ for kind in found - listed if getattr(kind, "update", None) not in known)
    assert not missing, f"add an example of {missing} to tests/laws/cases.py"


def test_every_registered_estimator_is_tried():
    cases = estimators()
    assert {name.split()[0] for name in cases} == set(ESTIMATORS) - {*OWN_SENSOR, *BEARINGS_ONLY, *SAMPLED}
    for name, options in cases.items():
        assert isinstance(make(name, options), Estimator)
