"""What there is: the classes of the code that the catalogue must have an entry of."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache
from typing import Any

import quietfix.diagrams
import quietfix.systems
from quietfix.systems import clocks
from quietfix.systems.estimators.watching import Watching
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.registry import ESTIMATORS, SMOOTHED, object_at
from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.starts.start import Start

__all__ = ["blocks", "clock_kinds", "estimators", "filters", "measurements", "motions", "slug", "starts"]

_NOT_IMPORTED = ("pytest_plugin",)


@cache
def _classes() -> dict[str, type]:
    found = {}
    for package in (quietfix.systems, quietfix.diagrams):
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if info.name.endswith(_NOT_IMPORTED):
                continue
            for name, kind in inspect.getmembers(importlib.import_module(info.name), inspect.isclass):
                if kind.__module__ == info.name and kind.__name__ == name and not name.startswith("_"):
                    found[f"{info.name}:{name}"] = kind
    return found


def _concrete(base: type) -> list[type]:
    found = [kind for kind in _classes().values() if issubclass(kind, base) and not inspect.isabstract(kind)]
    return sorted(found, key=lambda kind: (kind.__name__, kind.__module__))


def _is_base(kind: type) -> bool:
    """Whether a block only holds what others share: what must be there for a block to run is not."""
    return kind in (EnsembleBlock, Watching) or any(
        getattr(kind, name, None) is not None and getattr(getattr(kind, name), "__isabstractmethod__", False)
        for name in dir(kind)
        if not name.startswith("__")
    )


def blocks() -> list[type]:
    """Return every kind of block that can stand in a diagram."""
    return [kind for kind in _concrete(EnsembleBlock) if not _is_base(kind) and kind.__name__ != "Tracked"]


def measurements() -> list[type]:
    """Return every measurement model."""
    return _concrete(MeasurementModel)


def motions() -> list[type]:
    """Return every motion model."""
    return _concrete(MotionModel)


def starts() -> list[type]:
    """Return every way in which an estimator begins."""
    return _concrete(Start)


def filters() -> list[type]:
    """Return every Gaussian filter that is one by itself; options that are filters stand with the estimators."""
    return [kind for kind in _concrete(GaussianFilter) if ".options." not in kind.__module__]


def clock_kinds() -> list[type]:
    """Return every clock."""
    return [kind for name in clocks.__all__ if inspect.isclass(kind := getattr(clocks, name)) and name != "Clock"]


def estimators() -> dict[str, type]:
    """Return the options class of every registered estimator by its name, and of what is made of others."""
    return {**{name: object_at(path) for name, path in ESTIMATORS.items()}, "smoothed": object_at(SMOOTHED)}


def slug(kind: Any) -> str:
    """Return the name of a class's entry, other than that of any other class."""
    return f"catalogue-{kind.__module__.removeprefix('quietfix.').replace('.', '-').replace('_', '-')}-{kind.__name__}"
