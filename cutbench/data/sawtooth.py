"""What is not smooth along a curve: the sawtooth of stick–slip in a measured force, and that of the mesh in a
computed one."""

from __future__ import annotations

import numpy as np
from scipy import signal

from cutbench.data.covariance import NOISE_FLOOR

#: A force that falls by this part of its largest has had a peak, behind which stick–slip may follow.
PEAK_PROMINENCE = 0.05
#: So many values behind the peak are the transition's.
TRANSITION = 5
#: The mean square of a few values is known to within a half: so many times the noise's variance is no tooth.
NOISE_MULTIPLE = 2.0


def sawtooth_variance(x: np.ndarray, y: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Variance (m,) of the sawtooth of a cut's measured force behind its first peak. It is 0 where the
    variance ``noise`` (m,) of the readings may be all of it, or where a load cell's least noise may be.

    A tooth is many readings wide, and within it they are as smooth as anywhere: their noise is not its size.
    The fall behind the peak itself is no tooth; it is what a model is to describe.
    """
    top, steady = np.abs(y).max(), behind_first_peak(y)
    if not steady[2:-2].any():
        return np.zeros(y.size)
    size = local_mean(x, x[2:-2][steady[2:-2]], squared_roughness(y)[steady[2:-2]])
    fallen = np.arange(y.size) > steady.argmax() - TRANSITION
    return np.where(
        fallen, np.maximum(size - np.maximum(NOISE_MULTIPLE * noise, (NOISE_FLOOR * top) ** 2), 0), 0
    )


def behind_first_peak(y: np.ndarray) -> np.ndarray:
    """Which values (m,) of a cut's force lie behind its first peak and the transition."""
    peaks, _ = signal.find_peaks(y, prominence=PEAK_PROMINENCE * np.abs(y).max())
    return np.arange(y.size) >= (peaks[0] + TRANSITION if peaks.size else y.size)


def roughness_variance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Variance (m,) of what is not smooth in a curve on the even grid ``x`` (m,), where m >= 5.

    What each value differs from the cubic through its four neighbours, as ``data.covariance.roughness`` has
    it, but as a mean square: jags come one by one, and a median would not see them.
    """
    return local_mean(x, x[2:-2], squared_roughness(y))


def squared_roughness(y: np.ndarray) -> np.ndarray:
    """Square (m − 4,) of what each value but the outermost differs from the cubic through its neighbours."""
    return np.convolve(y, np.array([1, -4, 6, -4, 1]) / np.sqrt(70), mode="valid") ** 2


def local_mean(x: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean (m,) of ``values`` (n,), known ``at`` (n,), in a window about each x (m,), a tenth of all wide."""
    window = np.exp(-(((x[:, None] - at) / (np.ptp(x) / 10)) ** 2) / 2)
    return window @ values / window.sum(axis=1)
