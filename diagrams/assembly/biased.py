"""What an estimator is given where its measurement has biases: they stand behind the target's state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from quietfix.diagrams.assembly.model import Assumed
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.biases.bias import Bias
from quietfix.systems.biases.biased import BiasedModel
from quietfix.systems.biases.start import BiasedStart
from quietfix.systems.biases.walking import WithBiases

__all__ = ["biased"]


def biased(assumed: Assumed, biases: Sequence[Bias], name: str, options: Any) -> Assumed:
    """Return what an estimator is given, with those biases that its rows, or those of its start, have.

    Raises
    ------
    UserError
        If the estimator knows nothing of biases.
    """
    start = assumed.start
    used = {*assumed.model.names, *(start.uses.names if start.uses is not None else ())}
    own = [bias for bias in biases if used & bias.rows.keys()]
    if not own:
        return assumed
    if not getattr(options, "takes_biases", False):
        kinds = "!Ekf, !Iekf, !Ukf, !Mgekf, !Imm, !Batch, a !Custom filter"
        raise UserError(f"estimators.{name}: it is not allowed with belief.biases; allowed are {kinds}")
    size, taken = assumed.motion.size, [bias.name for bias in own if bias.name in assumed.motion.names]
    if taken:
        raise UserError(f"belief.biases: {taken[0]} is not allowed; the target's state has a component of that name")
    return replace(
        assumed,
        model=BiasedModel(assumed.model, size, own),
        motion=WithBiases(assumed.motion, own),
        start=BiasedStart(start, own, assumed.rows, size),
    )
