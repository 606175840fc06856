"""How late a row may be: as the command line says, else the belief; and a target that is lost is told to be."""

import pytest

from quietfix.diagrams.live.command import Asked, with_buffer
from quietfix.diagrams.parts.latency import LateBelief
from quietfix.diagrams.schema.errors import UserError
from tests.live.test_live import play


def test_the_belief_says_how_late_a_row_may_be():
    assert with_buffer(Asked(), LateBelief()).lag == 0.0
    assert with_buffer(Asked(), LateBelief(buffer_s=4.0)).lag == 4.0
    assert with_buffer(Asked(lag=2.0), LateBelief(buffer_s=4.0)).lag == 2.0
    with pytest.raises(UserError, match=r"belief\.late\.times: arrival is not allowed live"):
        with_buffer(Asked(), LateBelief(times="arrival"))


def test_lost_is_told(rows):
    """Not while all is well; where differences are 30 us off, to and fro, innovations go on to be too large."""
    told, _ = play(rows)
    assert all(one["lost"] is False for one in told if one["target"] == "0")  # the filter of the other one is off
    swung = [
        {**row, "value": float(row["value"]) + (3e4 if int(float(row["time_s"])) % 2 else -3e4)}
        if row["kind"] == "tdoa"
        else row
        for row in rows
    ]
    told, _ = play(swung)
    assert any(one["lost"] is True for one in told if one["target"] == "0")
