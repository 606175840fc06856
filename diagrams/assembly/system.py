"""A system: its scenario with its layers, and what it declares of one."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram, DiagramBuilder

from quietfix.diagrams.assembly.build import Assembly, build
from quietfix.diagrams.assembly.checks import check_model
from quietfix.diagrams.assembly.lineup import check_names, refuse_classes, select_estimators
from quietfix.diagrams.assembly.model import Model
from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.schema.errors import UserError, choose, texts
from quietfix.diagrams.schema.origins import Origins
from quietfix.diagrams.schema.reading import check_annotations
from quietfix.diagrams.schema.scenario import apply_setting, check_object, dump, load, merge, read_yaml
from quietfix.systems.clocks import Periodic
from quietfix.systems.counting import tally

__all__ = ["Layer", "System", "packaged"]

Layer = Mapping[str, Any] | Path
"""Values of a scenario, laid over those below: as a mapping, or in a YAML file."""

_NAME = re.compile(r"[^\W_][\w+-]{0,59}")  # it names files, folders and the diagram
_MOST_EPOCHS = 1_000_000  # hours for one trial and one filter


@dataclass(frozen=True, eq=False)
class System:
    """What is simulated.

    Attributes
    ----------
    name : str
        Letters, digits, ``_``, ``-`` and ``+``.
    title : str
        One line.
    scenario : type
        Dataclass of its scenario, with the field ``estimators``: options by name, as a mapping of str to
        `quietfix.systems.registry.estimator_options`.
    declare : callable
        ``declare(scenario) -> Model``.
    base : mapping or Path
        The scenario without a variant, as far as it is not the defaults of the dataclass: values, or a YAML file.
    variants : mapping of str to mapping or Path
        What each variant lays over it.
    file : Path, optional
        The YAML file that all of it was read from.
    recording : Source, optional
        Of a recording: where it comes from. Its scenario has the field ``data``, the folder or the files.
    estimates : bool
        False where measurements are all that there is, and no estimator can run.

    Raises
    ------
    ValueError
        If one of these is not what it must be.
    """

    name: str
    title: str
    scenario: type
    declare: Callable[[Any], Model]
    base: Layer = field(default_factory=dict)
    variants: Mapping[str, Layer] = field(default_factory=dict)
    file: Path | None = None
    recording: Source | None = None
    estimates: bool = True

    def __post_init__(self) -> None:
        """Check the arguments, and that YAML can fill the scenario."""
        for what, value in (("name", self.name), *(("variant", name) for name in self.variants)):
            if not isinstance(value, str) or not _NAME.fullmatch(value):
                raise ValueError(f"System: {what}: {value!r} is not allowed; letters, digits, _, - and +, at most 60")
        if not isinstance(self.title, str) or "\n" in self.title:
            raise ValueError(f"System {self.name}: title: {self.title!r} is not allowed; one line of text")
        if not (isinstance(self.scenario, type) and dataclasses.is_dataclass(self.scenario)):
            raise ValueError(f"System {self.name}: scenario: {self.scenario!r} is not allowed; a dataclass (the type)")
        if "estimators" not in {one.name for one in dataclasses.fields(self.scenario)}:
            raise ValueError(f"System {self.name}: scenario: {self.scenario.__qualname__} lacks the field estimators")
        if not callable(self.declare):
            raise ValueError(f"System {self.name}: declare: {self.declare!r} is not allowed; a function of a scenario")
        for where, layer in (("base", self.base), *((f"variants.{k}", v) for k, v in self.variants.items())):
            if not isinstance(layer, Mapping | Path):
                raise ValueError(f"System {self.name}: {where}: {layer!r} is not allowed; a mapping, or a Path")
        check_annotations(self.scenario)

    # ---- the scenario

    def load(
        self,
        variant: str | None = None,
        file: Path | str | None = None,
        settings: Sequence[str] = (),
        text: str | None = None,
        trust: bool = False,
    ) -> Any:
        """Return the scenario: the base, then the variant's values, a user's file, and settings.

        Parameters
        ----------
        variant : str, optional
            Which variant.
        file : path, optional
            A user's YAML; what it does not say stays.
        settings : sequence of str
            ``KEY=VALUE``, dotted.
        text : str, optional
            A whole scenario as text, instead of base and variant (a result carries its own).
        trust : bool
            Whether `text` may name classes, which are imported when the scenario is wired.

        Returns
        -------
        dataclass
            The system's scenario.

        Raises
        ------
        UserError
            Naming the field, the value and what is allowed, or a class that the text names without `trust`.
        """
        settings = texts("set", settings)
        if text is not None:
            data = read_yaml(text)
            if not trust:
                refuse_classes(load(self.scenario, [data]))
        else:
            with Origins([] if self.file is None else [self.file]).placing():
                data = self._base()
            if variant is not None:
                data = merge(data, _values(self.variants[self.variant(variant)]))
        if file is not None:
            data = merge(data, read_yaml(Path(file)))
        for setting in settings:
            data = apply_setting(data, setting)
        written = [self.file if text is None else None, None if file is None else Path(file)]
        origins = Origins([path for path in written if path is not None], settings)
        with origins.placing():
            written_down = load(self.scenario, [data])
            origins.remember(written_down)
            scenario = _checked(written_down)
            if scenario is not written_down:
                origins.remember(scenario)
        return scenario

    def resolve(self, variant: str | None, scenario: Any, settings: Any) -> Any:
        """Return the scenario of a study: loaded, or a user's object, checked.

        Parameters
        ----------
        variant : str, optional
            Which variant.
        scenario : path, str, dataclass or None
            A user's YAML file, a whole scenario object, or nothing.
        settings : sequence of str, mapping or None
            ``KEY=VALUE``, or values by dotted key.

        Raises
        ------
        UserError
            Naming the field, the value and what is allowed.
        """
        if isinstance(settings, Mapping):
            settings = [f"{key}={'null' if value is None else value}" for key, value in settings.items()]
        settings = texts("set", settings)
        if scenario is None or isinstance(scenario, str | Path):
            return self.load(variant, scenario, settings)
        check_object(self.scenario, scenario)
        if settings:
            raise UserError("set: it cannot be combined with a scenario object; change its fields instead")
        return _checked(scenario)

    def variant(self, name: str) -> str:
        """Return the name of a variant, if there is such a one.

        Raises
        ------
        UserError
            If there is none.
        """
        return choose(f"variant of {self.name}", name, sorted(self.variants))

    def _base(self) -> dict[str, Any]:
        data = _values(self.base)
        # Written out, so that one changed option of an estimator leaves the others of the defaults there; a file is
        # whole by itself.
        if isinstance(self.base, Path):
            return data
        try:
            written = read_yaml(dump(load(self.scenario, [data]), comments=False))
            load(self.scenario, [written])  # checks the defaults, too
            return written
        except UserError as error:
            if self.file is not None:  # it says where by itself
                raise
            raise UserError(f"System {self.name}: {self.scenario.__qualname__}: {error}") from error

    # ---- the diagram

    def model(self, scenario: Any) -> Model:
        """Return what a scenario declares: once for all diagrams of it, for it may solve equations or read files.

        Raises
        ------
        ValueError
            If something does not fit.
        """
        tally("declared")
        model = self.declare(scenario)
        if not isinstance(model, Model):
            raise ValueError(
                f"declare: it returned {type(model).__name__}; quietfix.diagrams.assembly.model.Model is needed"
            )
        check_model(model)
        if isinstance(model.clock, Periodic) and not model.duration <= _MOST_EPOCHS * model.clock.period:
            raise ValueError(
                f"duration: {model.duration:g} is not allowed; at most {_MOST_EPOCHS} epochs of "
                f"{model.clock.period:g} s"
            )
        return model

    def build(self, builder: DiagramBuilder, scenario: Any, estimators: Sequence[str], trials: int) -> Assembly:
        """Put what a scenario declares and the estimators of these names into one diagram; see `build`."""
        options = {name: scenario.estimators[name] for name in estimators}
        return build(self.model(scenario), builder, options, trials)

    def diagram(
        self, scenario: Any = None, trials: int = 1, set: Sequence[str] | Mapping[str, Any] | None = None
    ) -> Diagram:
        """Return the finished diagram, to simulate by hand; `set_draw` gives its context a seed.

        To add blocks of your own, call `build` with your own builder: it returns the `Assembly`, on whose ``bus`` every
        signal is.

        Parameters
        ----------
        scenario : path, str or dataclass, optional
            See `resolve`.
        trials : int
            Trials of the ensemble.
        set : sequence of ``KEY=VALUE`` or mapping, optional
            Changes of the scenario.

        Raises
        ------
        ValueError
            If something does not fit.
        """
        resolved = self.resolve(None, scenario, set)
        builder = DiagramBuilder()
        return self.build(builder, resolved, select_estimators(resolved, None), trials).finish(self.name)


def packaged(name: str) -> dict[str, Any]:
    """Return base and variants of a system that comes with Quietfix: ``scenarios/NAME.yaml``, ``NAME.VARIANT.yaml``."""
    folder = Path(str(files("quietfix.diagrams.library"))) / "scenarios"
    variants = {path.name.split(".")[1]: path for path in sorted(folder.glob(f"{name}.*.yaml"))}
    return {"base": folder / f"{name}.yaml", "variants": variants}


def _values(layer: Layer) -> dict[str, Any]:
    return read_yaml(layer) if isinstance(layer, Path) else dict(layer)


def _checked(scenario: Any) -> Any:
    """Return a scenario whose fields make sense together, and in which what is short for others is written out.

    A scenario may have the methods ``completed() -> scenario`` and ``refused() -> str``: what is wrong with it.
    """
    if callable(getattr(scenario, "completed", None)):
        scenario = scenario.completed()
    if callable(getattr(scenario, "refused", None)) and (refused := scenario.refused()):
        raise UserError(refused)
    _check_epochs(scenario)
    check_names(scenario)
    return scenario


def _check_epochs(scenario: Any) -> None:
    """Refuse a run that would hardly end, in the words of the scenario where it has a period, and an end."""
    end = "stop_s" if hasattr(scenario, "stop_s") else "duration_s"
    if not hasattr(scenario, "period_s") or not hasattr(scenario, end):
        return
    if not scenario.period_s > 0:
        raise UserError(f"period_s: {scenario.period_s:g} is not allowed; a finite number > 0")
    longest = _MOST_EPOCHS * scenario.period_s + getattr(scenario, "start_s", 0.0)
    if getattr(scenario, end) > longest:
        raise UserError(
            f"{end}: {getattr(scenario, end):g} is not allowed; at most {longest:g}, {_MOST_EPOCHS} epochs of period_s "
            f"{scenario.period_s:g}"
        )
