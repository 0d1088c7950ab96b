"""The share of the contaminant layer that friction work leaves when the recovery has another shape than the paper's eq. (4)."""

import math

from wsp_env.compiled import kernel

_WORK_FLOOR = 1e-12  # tau W_sp [-] from which on the rate of a recovery with an exponent below 1 is finite


@kernel
def kept_by_shape(rest: float, gap: float, a: float, offset: float, exponent: float) -> tuple[float, float]:
    """Solve f = rest - gap exp(-u^n) with u = max(a f - offset, 0), n = exponent, for its lowest root f [-].

    Return exp(-u^n) [-] and n u^(n - 1), its relative rate. A wheel comes from low slip, so of several roots (n > 1) it is on
    the lowest. The right side is convex in f up to u^n = (n - 1) / n and concave beyond: Newton's method runs up to the root
    in the convex part, and if there is none, down to the only one in the concave part, monotonically in both. A negative gap
    (more friction with the contaminant than without) has one root only.
    """
    low = rest - gap
    if a * low <= offset and gap >= 0.0:  # the threshold is not reached
        return 1.0, 0.0
    f = rest
    bend = ((exponent - 1.0) / exponent) ** (1.0 / exponent) if exponent > 1.0 else 0.0
    if a * low - offset < bend and gap > 0.0:
        f = low
        for _ in range(60):
            u = max(a * f - offset, _WORK_FLOOR)
            power = u**exponent
            kept = math.exp(-power)
            steep = 1.0 - gap * kept * exponent * power / u * a
            step = (rest - gap * kept - f) / steep if steep > 0.0 else math.inf
            if a * (f + step) - offset > bend:
                f = rest
                break
            f += step
            if step <= 1e-15:
                break
    if f == rest:
        for _ in range(60):
            u = max(a * f - offset, _WORK_FLOOR)
            power = u**exponent
            kept = math.exp(-power)
            step = (f - rest + gap * kept) / (1.0 - gap * kept * exponent * power / u * a)
            f -= step
            if abs(step) <= 1e-15:
                break
    u = max(a * f - offset, _WORK_FLOOR)
    power = u**exponent
    return math.exp(-power), exponent * power / u
