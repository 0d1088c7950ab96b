"""Removes from a slip the noise of its sensor, scale by scale, and keeps the motion of the wheel.

A wheel under an active WSP changes its speed within tenths of a second; under a steady full brake it hardly does. Noise that
remains after a short smoothing looks like acceleration of the wheel. It is correlated with the noise of the recorded
acceleration, and a fit then finds too little inertia (noise in an explanatory variable). The noise in the difference between
two smoothings is known from the sensor's noise. This share is removed (positive-part James-Stein estimator, local in time; W.
James, C. Stein, Proc. 4th Berkeley Symposium, 1961).
"""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

#: Windows [s] of the smoothings, each twice the previous. The shortest keeps the actions of a WSP; longer ones than the last
#: have no visible effect.
WINDOWS_S = (0.25, 0.5, 1.0)
#: Number of windows over which the energy of a scale is averaged: its standard error is then about a quarter.
_AVERAGED = 8
_ORDER = 3


def denoised(
    slip: np.ndarray, share: np.ndarray, deviation: float, filtered: np.ndarray, step: float, raw_step: float
) -> np.ndarray:
    """Return a slip without the sensor noise that remains in it, judged by the energy of its rate.

    Parameters
    ----------
    slip : (T, A) [m/s], filtered and thinned
    share : (T, A) [-] of the sensor's noise that the slip contains
    deviation : standard deviation of the white noise of a raw sample [m/s]
    filtered : (w,) weights of the filter that was applied to the raw samples
    step, raw_step : between the samples and between the raw samples [s]

    """
    smooth = [savgol_filter(slip, _length(window, step, len(slip)), _ORDER, axis=0) for window in WINDOWS_S]
    stride = max(round(step / raw_step), 1)
    kernels = [savgol_coeffs(_length(window, step, len(slip)), _ORDER) for window in WINDOWS_S]
    result: np.ndarray = smooth[0].copy()
    share = uniform_filter1d(share, _length(WINDOWS_S[0], step, len(slip)), axis=0)
    for k, window in enumerate(WINDOWS_S[1:]):
        detail = smooth[k] - smooth[k + 1]
        weights = -kernels[k + 1]
        middle = (len(weights) - len(kernels[k])) // 2
        weights[middle : middle + len(kernels[k])] += kernels[k]
        noise = deviation**2 * float(np.sum(_as_raw(np.gradient(np.pad(weights, 1)) / step, stride, filtered) ** 2))
        energy = uniform_filter1d(np.gradient(detail, step, axis=0) ** 2, _length(_AVERAGED * window, step, len(slip)), axis=0)
        result -= share * np.minimum(noise / np.maximum(energy, 1e-300), 1.0) * detail
    return result


def _as_raw(weights: np.ndarray, stride: int, filtered: np.ndarray) -> np.ndarray:
    """Return the weights of raw samples for a filter `weights` on every stride-th output of the filter `filtered`."""
    spread = np.zeros((len(weights) - 1) * stride + 1)
    spread[::stride] = weights
    return np.convolve(spread, filtered)


def _length(window_s: float, step_s: float, most: int) -> int:
    length = 2 * round(0.5 * window_s / step_s) + 1
    return max(min(length, most - 1 + most % 2), _ORDER + 2)
