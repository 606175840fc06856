"""Figure of the cross-ambiguity function."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from quietfix.diagrams.figures.shared.style import new_figure
from quietfix.systems.ambiguity.surface import Surface

__all__ = ["draw_surface"]


def draw_surface(surface: Surface, found: tuple[float, float] | None = None, title: str = "") -> Figure:
    """Draw the magnitude of the function over delay and frequency, and its cuts through a point.

    Parameters
    ----------
    surface : Surface
        What `quietfix.systems.ambiguity.surface.ambiguity_surface` returned.
    found : (float, float), optional
        TDOA [s] and FDOA [Hz] to be marked, and through which the cuts go; default: the highest point.
    title : str
        Above the figure.
    """
    figure, axes = new_figure(height=7.5, rows=2, columns=2, width_ratios=(3, 1.4), height_ratios=(1.2, 3))
    (along_frequency, corner), (image, along_delay) = axes
    corner.remove()
    delay, frequency, magnitude = 1e6 * surface.delay, surface.frequency, surface.magnitude
    row, column = divmod(int(np.argmax(magnitude)), magnitude.shape[1])
    point = delay[row], frequency[column]
    if found is not None:
        point = 1e6 * found[0], found[1]
        row, column = (int(np.argmin(np.abs(grid - at))) for grid, at in zip((delay, frequency), point, strict=True))
    shown = image.pcolormesh(frequency, delay, magnitude, cmap="viridis", shading="auto", rasterized=True)
    image.plot(point[1], point[0], "o", ms=18, fillstyle="none", color="white", mew=1.5)
    image.set(xlabel="frequency difference [Hz]", ylabel="time difference [us]")
    along_frequency.plot(frequency, magnitude[row], color="#0072b2", lw=1.6)
    along_frequency.set(xlim=image.get_xlim(), ylabel="|A|, normalised", title=f"cut at {point[0]:.3f} us")
    along_delay.plot(magnitude[:, column], delay, color="#d55e00", lw=1.6)
    along_delay.set(ylim=image.get_ylim(), xlabel="|A|, normalised", title=f"cut at {point[1]:.2f} Hz")
    for panel, axis in ((along_frequency, "y"), (along_delay, "x")):
        panel.grid(True, color="0.85", lw=0.8)
        panel.set(**{f"{axis}lim": (0, 1.05 * float(magnitude.max()))})
    figure.colorbar(shown, ax=along_delay, label="|A|, normalised")
    figure.suptitle(title or "Cross-ambiguity function")
    return figure
