"""Figures for paper and screen: one style, one file a picture."""

from cutbench.plots.curve import plot_curve
from cutbench.plots.section import plot_section
from cutbench.plots.style import save

__all__ = ["plot_curve", "plot_section", "save"]
