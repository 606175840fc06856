"""What `quietfix identify` tells: a table, a verdict in words, numbers for a file."""

from __future__ import annotations

from typing import Any

import numpy as np

from quietfix.diagrams.console.tables import Column, Styled, Table, three_digits
from quietfix.diagrams.identification.blocks import MUCH
from quietfix.diagrams.identification.priors import Priors
from quietfix.diagrams.identification.ranking import Ranked, Ranking
from quietfix.diagrams.readers.doppler.received import Received
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["cautions", "entry", "table_of", "verdict"]

_SHOWN = 10
_LARGE = 1e6  # odds
_AGED = 10.0  # days


def table_of(ranking: Ranking, received: Received, priors: Priors) -> Table:
    """Return the table that is printed: the best ten objects."""
    headings = ["rms [m/s]", "rms [Hz]", "bias [Hz]"]
    headings += ["drift [Hz/s]"] if priors.order > 1 else []
    headings += ["drift rate [Hz/s^2]"] if priors.order > 2 else []
    headings += ["ahead [s]", "highest [deg]", "age [days]", "odds", "probability"]
    passes = ranking.ranked[0].oscillator.shape[0]
    table = Table(
        f"{received.path.name}: {np.count_nonzero(ranking.used)} of {ranking.used.size} rows, carrier "
        f"{received.carrier / 1e6:.6f} MHz",
        [Column("object"), *headings],
        caption="rms: of the used rows; bias: of the oscillator in the middle of the pass"
        + ("" if passes == 1 else f", here the first of {passes}")
        + "; ahead: of the elements, along the orbit; age: of the elements; odds: how many times as likely the first "
        "one is; probability: if it is one of these objects, each as likely before.",
    )
    for i, one in enumerate(ranking.ranked[:_SHOWN]):
        style = ("green" if ranking.identified else "yellow") if i == 0 else ""
        table.add(Styled(one.heard.elements.label, style), *_cells(one, received))
    return table


def _cells(one: Ranked, received: Received) -> list[str]:
    hertz = received.carrier / SPEED_OF_LIGHT
    return [
        f"{one.rms:.1f}",
        three_digits(one.rms * hertz),
        *(three_digits(-value * hertz) for value in one.oscillator[0]),
        f"{one.ahead:+.2f} ± {one.ahead_sigma:.2f}",
        f"{one.heard.highest:.1f}",
        f"{one.heard.age:+.1f}",
        _odds(one),
        f"{one.probability:.3f}",
    ]


def _odds(one: Ranked) -> str:
    odds = float(np.exp(min(-one.likelihood, 700.0)))
    return f"> {_LARGE:.0e}".replace("e+0", "e") if odds > _LARGE else three_digits(odds)


def verdict(ranking: Ranking) -> str:
    """Return what is to be believed, in a sentence or two."""
    best = ranking.ranked[0]
    name = best.heard.elements.label
    if not ranking.explained:
        return _unexplained(ranking)
    if ranking.rivals or not ranking.identified:
        rivals = ranking.rivals or ranking.ranked[1:2]
        shown = ", ".join(one.heard.elements.label for one in rivals[:5])
        more = f" and {len(rivals) - 5} more" if len(rivals) > 5 else ""
        return (
            f"not identified: {name} is the most likely one (probability {best.probability:.2f}), but cannot be told "
            f"from {shown}{more}"
        )
    if len(ranking.ranked) == 1:
        return f"identified: {name} explains the recording; no other object of the file comes near it"
    second = ranking.ranked[1]
    return (
        f"identified: {name}, {_odds(second).replace('> ', 'more than ')} times as likely as the next one, "
        f"{second.heard.elements.label}"
    )


def _unexplained(ranking: Ranking) -> str:
    best = ranking.ranked[0]
    name = best.heard.elements.label
    if abs(best.ahead) >= 4 * best.prior_time:
        return (
            f"not identified: {name} comes nearest, but would be {best.ahead:+.2f} s ahead of its elements, of which "
            f"{best.prior_time:.2f} s is one standard deviation (--time-sigma)"
        )
    return (
        f"not identified: {name} comes nearest, but what it leaves is no noise: {ranking.scale:.0f} m/s, "
        f"{ranking.systematic:.1f} times what a smooth curve leaves of that; another object, an oscillator that does "
        "more (--oscillator rate), or another station"
    )


def cautions(ranking: Ranking, priors: Priors) -> list[str]:
    """Return what a reader must know of the best object."""
    best = ranking.ranked[0]
    notes = []
    if abs(best.heard.age) > _AGED:
        notes.append(
            f"the elements of {best.heard.elements.label} are {abs(best.heard.age):.0f} days from the recording"
        )
    if ranking.more > MUCH:
        word = "a drift" if priors.order == 1 else "one more state of the oscillator"
        notes.append(f"{word} would explain the rows {np.exp(min(ranking.more, 99)):.2g} times as well: --oscillator")
    if ranking.together > 1.5:
        notes.append(f"residuals hang together: {ranking.together:.1f} neighbouring blocks of 100 count as one")
    return notes


def entry(ranking: Ranking, received: Received, priors: Priors) -> dict[str, Any]:
    """Return what ``identification.json`` holds."""
    hertz = received.carrier / SPEED_OF_LIGHT
    names = ("bias_hz", "drift_hzps", "drift_rate_hzps2")[: priors.order]
    best = ranking.ranked[0].heard.elements
    return {
        "schema_version": 1,
        "verdict": verdict(ranking),
        "identified": best.number if ranking.identified else None,
        "rivals": [one.heard.elements.number for one in ranking.rivals],
        "carrier_hz": received.carrier,
        "rows": int(ranking.used.size),
        "rows_used": int(np.count_nonzero(ranking.used)),
        "lines_left_out": _spans(received.lines[~ranking.used]),
        "sigma_row_mps": ranking.noise,
        "sigma_block_mps": ranking.scale,
        "blocks_together": ranking.together,
        "systematic": json_numbers(ranking.systematic),
        "notes": [*received.notes, *ranking.notes, *cautions(ranking, priors)],
        "objects": [
            {
                "number": one.heard.elements.number,
                "name": one.heard.elements.name,
                "rms_mps": one.rms,
                "rms_hz": one.rms * hertz,
                **{name: json_numbers(-one.oscillator[:, i] * hertz) for i, name in enumerate(names)},
                **{f"sigma_{name}": json_numbers(one.oscillator_sigma[:, i] * hertz) for i, name in enumerate(names)},
                "ahead_s": one.ahead,
                "sigma_ahead_s": one.ahead_sigma,
                "prior_sigma_ahead_s": one.prior_time,
                "highest_deg": one.heard.highest,
                "age_days": one.heard.age,
                "log_likelihood_ratio": one.likelihood,
                "probability": one.probability,
            }
            for one in ranking.ranked
        ],
    }


def _spans(lines: Any) -> list[list[int]]:
    """Return first and last line of every run of lines."""
    if not lines.size:
        return []
    ordered = np.sort(lines)
    return [[int(run[0]), int(run[-1])] for run in np.split(ordered, np.flatnonzero(np.diff(ordered) > 1) + 1)]
