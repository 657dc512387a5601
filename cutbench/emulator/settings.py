"""The numbers that the emulator and the atlas rest on beside their runs: all of them, with their reasons."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import ndtri


@dataclass(frozen=True)
class Settings:
    """What is taken for small, near, far and enough.

    Attributes
    ----------
    small_force : float
        Part of the usual largest force: a force below counts as it is, one above by its logarithm.
    spare : int
        So many curves more than coordinates, beside the trend, are needed before a process says anything.
    reaches : int
        Groups of curves that reach equally far beyond their onsets, each of which has a process.
    points : int
        Travels at which the curves of a campaign's cuts are said.
    extrapolation : float
        Beyond the range of the known runs by more than this part of it nothing is said.
    beyond : float
        Part of a side as far as which the atlas speaks of given sizes that lie beyond it: of a specimen ten
        thicknesses of its blade high.
    intervals : int
        Parts of the way to the onset, between which curves of the atlas are straight.
    travels : tuple of float
        The same of travels beyond the onset, in halves of the blade's thickness.
    blurs, bendings : int
        Places within the travel over which a drop's forces are blurred; and so often a curve is bent to have
        its drop.
    draws : int
        Curves that are drawn for an interval along the travel.
    level : float
        Part of the runs that an interval holds.
    """

    small_force: float = 0.05
    spare: int = 3
    reaches: int = 6
    points: int = 80
    extrapolation: float = 0.25
    beyond: float = 0.3
    intervals: int = 24
    travels: tuple[float, ...] = (
        0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1, 1.2, 1.5, 1.8, 2.2, 2.6, 3, 3.5, 4, 4.5, 5, 6
    )  # fmt: skip
    blurs: int = 20
    bendings: int = 3
    draws: int = 200
    level: float = 0.9

    @property
    def quantile(self) -> float:
        """Standard deviations to the ends of an interval."""
        return float(ndtri((1 + self.level) / 2))


SETTINGS = Settings()
