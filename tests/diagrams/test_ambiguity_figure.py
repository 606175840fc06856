"""The picture of the cross-ambiguity function."""

import numpy as np

from quietfix.diagrams.figures.ambiguity import draw_surface
from quietfix.systems.ambiguity.surface import Surface


def test_axes_and_cuts(tmp_path):
    delay, frequency = np.linspace(-1e-6, 1e-6, 21), np.linspace(-50.0, 50.0, 31)
    magnitude = np.exp(-(((delay[:, None] - 2e-7) / 4e-7) ** 2) - (frequency / 20) ** 2)
    surface = Surface(delay, frequency, magnitude)
    for found in (None, (2e-7, 0.0)):
        figure = draw_surface(surface, found, "peak")
        labels = {axes.get_xlabel() for axes in figure.axes} | {axes.get_ylabel() for axes in figure.axes}
        assert {"frequency difference [Hz]", "time difference [us]", "|A|, normalised"} <= labels
        titles = [axes.get_title() for axes in figure.axes]
        assert "cut at 0.200 us" in titles and "cut at 0.00 Hz" in titles
    figure.savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
