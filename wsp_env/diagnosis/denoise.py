"""Takes from a slip what its sensor's noise put into it, scale by scale, and leaves what the wheel did.

A wheel under a protection that acts changes its speed within tenths of a second, one on a full brake hardly. What a short
smoothing leaves of noise in the second looks like its acceleration, and shares its noise with the recorded one: a fit then
takes away inertia (noise in an explanatory variable). How much of the difference between two smoothings is noise is known from
the sensor's: that share is taken away (James and Stein's positive part, local in time; W. James, C. Stein, Proc. 4th Berkeley
Symposium, 1961).
"""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

#: Windows [s] of the smoothings, each twice the one before: the shortest keeps what a protection does, a longer one than the
#: last changes nothing that is seen.
WINDOWS_S = (0.25, 0.5, 1.0)
#: Windows over which the energy of a scale is averaged: so many independent values say it to a quarter.
_AVERAGED = 8
_ORDER = 3


def denoised(
    slip: np.ndarray, share: np.ndarray, deviation: float, filtered: np.ndarray, step: float, raw_step: float
) -> np.ndarray:
    """Return a slip smoothed as far as it is noise, by the energy of its rate.

    Parameters
    ----------
    slip : (T, A) [m/s], as filtered and thinned
    share : (T, A) [-] of the sensor's noise that is in it
    deviation : of a raw sample's white noise [m/s]
    filtered : (w,) weights of the filter that raw samples have passed
    step, raw_step : between the samples and between the raw ones [s]

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
    """Return the weights with which raw samples come into what weighs every stride-th of them after a filter."""
    spread = np.zeros((len(weights) - 1) * stride + 1)
    spread[::stride] = weights
    return np.convolve(spread, filtered)


def _length(window_s: float, step_s: float, most: int) -> int:
    length = 2 * round(0.5 * window_s / step_s) + 1
    return max(min(length, most - 1 + most % 2), _ORDER + 2)
