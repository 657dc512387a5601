"""Figures for paper and screen: one style, one file a picture."""

from cutbench.base.figure_style import save
from cutbench.run.figures.curve import plot_curve, plot_curves
from cutbench.run.figures.section import plot_section

__all__ = ["plot_curve", "plot_curves", "plot_section", "save"]
