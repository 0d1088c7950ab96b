"""Thins prepared stops to the time step at which models are evaluated, by averaging neighbouring samples."""

import dataclasses
from typing import Any

import numpy as np

from wsp_env.diagnosis.stops import PreparedStop

EVALUATED_S = 0.04  # approximate time step of evaluations


def thinned(stop: PreparedStop) -> PreparedStop:
    """Return the stop with neighbouring samples averaged to a step of about `EVALUATED_S`."""
    stride = max(round(EVALUATED_S / stop.step_s), 1)
    if stride == 1:
        return stop
    mean: dict[str, Any] = {
        field.name: averaged(getattr(stop, field.name), stop.step_s)
        for field in dataclasses.fields(PreparedStop)
        if isinstance(getattr(stop, field.name), np.ndarray) and field.name not in ("usable", "segment")
    }
    segment = cut(stop.segment, stride)
    usable: np.ndarray = np.all(cut(stop.usable, stride), axis=1)
    whole = (segment == segment[:, :1]).all(axis=1)
    return dataclasses.replace(
        stop,
        step_s=stop.step_s * stride,
        usable=usable,
        segment=np.where(whole, segment[:, 0], -1),
        **mean,
    )


def averaged(values: np.ndarray, step: float) -> np.ndarray:
    """Return means (T', ...) of neighbouring samples (T, ...), with a step of about `EVALUATED_S`."""
    stride = max(round(EVALUATED_S / step), 1)
    result: np.ndarray = values if stride == 1 else cut(values, stride).mean(axis=1)
    return result


def cut(values: np.ndarray, stride: int) -> np.ndarray:
    """Return samples (T, ...) in groups (T', stride, ...) of neighbouring ones; an incomplete last group is left out."""
    kept = len(values) // stride
    return values[: kept * stride].reshape(kept, stride, *values.shape[1:])
