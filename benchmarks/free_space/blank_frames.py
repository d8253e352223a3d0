"""Random scenes in which some things are blank: none of their pixels is measured, at any range.

Everything follows from (seed, number), as in random_frames.py. Stereo measures the upright edges of a blank thing; here not
even these are measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.free_space.random_frames import RandomFrame, random_frame
from core.types import UNKNOWN_MM

BLANK_SHARE = 0.4
"""Share of the things that are blank."""


def blank_frame(seed: int, number: int) -> RandomFrame:
    """The random frame of a number without the pixels of some of its things; the same for the same seed and number."""
    r = random_frame(seed, number)
    rng = np.random.Generator(np.random.PCG64([seed, number, 1]))
    # label -1, the ground and the sky, is the last one and never blank
    blank = np.append(rng.random(len(r.frame.scene.names)) < BLANK_SHARE, False)
    hidden = blank[r.frame.truth.label(r.frame.scene)]
    return replace(r, frame=replace(r.frame, depth_mm=np.where(hidden, UNKNOWN_MM, r.frame.depth_mm).astype(np.uint16)))
