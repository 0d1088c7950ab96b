"""What readers of measurement systems' files share: extras asked for by name, damage said in one sentence, vectors of floats.

The libraries raise whatever their parsers stumble over in a damaged file (struct.error, KeyError, MemoryError, their own),
so everything is caught here.
"""

import contextlib
import gc
import importlib
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.recordings.errors import CampaignError, first_line

#: What to do about a damaged file.
AGAIN = "copy it again from where it was recorded, or export it again"


def vector(file: Path, name: str, values: ArrayLike) -> np.ndarray:
    """Return the samples of a channel as floats (n,), masked ones as nan; `CampaignError` for samples that are no numbers."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    samples = np.asarray(values)
    if samples.dtype.kind not in "fiub":
        raise CampaignError(f"{file}, channel {name}: its samples are no numbers; export it as numbers")
    return np.ravel(samples).astype(float, copy=False)


def extra(name: str, file: Path) -> ModuleType:
    """Return a module of the extra [data]; `CampaignError` says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise CampaignError(f'{file}: reading {file.suffix} files needs {name}: pip install "wsp-env[data]"') from None


@contextlib.contextmanager
def one_sentence(file: Path, what: str) -> Iterator[None]:
    """Raise `CampaignError` with one sentence for whatever a library stumbles over."""
    problem = ""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None  # asammdf's destructor stumbles over files that it could not open
    try:
        yield
    except CampaignError:
        raise
    except Exception as error:
        problem = first_line(error)
        traceback.clear_frames(error.__traceback__)
        gc.collect()  # lets go of the half-opened file while nobody hears it
    finally:
        sys.unraisablehook = hook
    if problem:
        raise CampaignError(f"{file} is damaged or not {what}: {problem}; {AGAIN}")
