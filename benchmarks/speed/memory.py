"""Does anything grow? One extractor, many frames of all kinds, its memory sampled on the way.

Run `python -m benchmarks.speed.memory --frames 100000`: a table and the growth per 10 000 frames after warm-up."""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import markdown
from benchmarks.speed.cases import KINDS, SEED, Kind, kind_sequence
from companion.bench.frames import Depth, FrameSequence
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.types import CameraInfo, ExtractorState

IMAGES: Final = 2
LARGE_SHARE: Final = 0.02
"""Of the frames are 640x480, the rest smaller: memory does not ask how long a frame took."""
SIZES: Final = ((160, 120), (320, 240))
LARGE: Final = (640, 480)
LEFT_OUT: Final = ("noise everywhere, 2x2 blocks",)
"""Kinds that take too long for a hundred thousand frames."""
MIX: Final = (
    "street and trees level and tilted, noise in a tenth of the image and everywhere, images without a measurement, integer and float "
    "depth, half of them at odd attitudes of up to 65 degrees of roll and pitch, 160x120 and 320x240, one frame in fifty 640x480"
)


Frame = tuple[Any, CameraInfo, Any]
"""Depth, camera, rotation."""


def _rejected_attitudes() -> tuple[NDArray[np.float64], ...]:
    rng = np.random.Generator(np.random.PCG64(SEED))
    angles = np.radians(rng.uniform(-65.0, 65.0, (12, 2)))
    return tuple(rotation_level_cam_optical(rotation_from_euler(r, p, 0.0) @ R_CAMFRD_OPTICAL) for r, p in angles)


REJECTED_ATTITUDES: Final = _rejected_attitudes()
"""Rolled and pitched at random; views of other sizes, and beyond 60 degrees none at all."""


@dataclass(frozen=True, slots=True)
class Sample:
    """Memory after a number of frames: resident memory of the process, arrays of the extractor, bytes; blocks allocated
    by Python; bytes allocated from the C library (0: unknown)."""

    frames: int
    resident: int
    held: int
    blocks: int
    in_use: int


def every_frame(shots: Sequence[FrameSequence]) -> Iterator[Frame]:
    """Every image at its own and at each of the odd attitudes, and once as float metres: after these nothing new comes."""
    for shot in shots:
        for depth in shot.depth_mm:
            yield in_metres(depth), shot.info, shot.R_level_optical
            for R in (shot.R_level_optical, *REJECTED_ATTITUDES):
                yield depth, shot.info, R


def in_metres(depth_mm: Depth) -> NDArray[np.float32]:
    """The other form in which an image may come."""
    return depth_mm.astype(np.float32) / np.float32(1000.0)


def mixed_frames(shots: Sequence[FrameSequence], large: Sequence[FrameSequence], seed: int = SEED) -> Iterator[Frame]:
    """The same without end, in an order that the seed decides, one image in ten as float metres."""
    rng = np.random.Generator(np.random.PCG64(seed))
    while True:
        among = large if large and rng.random() < LARGE_SHARE else shots
        shot = among[int(rng.integers(len(among)))]
        depth: Any = shot.depth_mm[int(rng.integers(len(shot.depth_mm)))]
        if rng.random() < 0.1:
            depth = in_metres(depth)
        odd = rng.random() < 0.5
        yield (
            depth,
            shot.info,
            REJECTED_ATTITUDES[int(rng.integers(len(REJECTED_ATTITUDES)))] if odd else shot.R_level_optical,
        )


def watch(
    first: Iterator[Frame],
    then: Iterator[Frame],
    frames: int,
    every: int,
    report: Callable[[Sample], None] = lambda s: None,
) -> list[Sample]:
    """Extracts all of `first`, then a number of frames of `then`, with one extractor. The first sample is taken between
    the two."""
    extractor, state = Extractor(), ExtractorState()
    for depth, info, R in first:
        state = extractor.extract(depth, info, R, state)[1]
    samples = [sample(0, extractor)]
    for number in range(1, frames + 1):
        depth, info, R = next(then)
        state = extractor.extract(depth, info, R, state)[1]  # no model is kept
        if number % every == 0:
            samples.append(sample(number, extractor))
            report(samples[-1])
    return samples


def sample(frames: int, extractor: Extractor) -> Sample:
    """The memory after a number of frames and a garbage collection."""
    gc.collect()
    return Sample(frames, resident_bytes(), held_bytes(extractor), sys.getallocatedblocks(), in_use_bytes())


def resident_bytes() -> int:
    """Of this process, as the kernel counts it."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class _Mallinfo(ctypes.Structure):
    """`struct mallinfo2` of glibc."""

    _fields_ = [(name, ctypes.c_size_t) for name in (
        "arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost",
    )]  # fmt: skip


def in_use_bytes() -> int:
    """Bytes allocated from glibc (2.33 or later); 0 with another C library.

    Resident memory alone hides a leak: freed memory stays with the allocator and is used for leaking allocations first.
    """
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallinfo2"):
        return 0
    library.mallinfo2.restype = _Mallinfo
    info = library.mallinfo2()
    return int(info.uordblks + info.hblkhd)


def held_bytes(owner: object) -> int:
    """Bytes of all arrays that can be reached from an object through its attributes, containers and objects of core."""
    seen: set[int] = set()
    total, todo = 0, [owner]
    while todo:
        thing = todo.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            root: NDArray[Any] = thing if thing.base is None or not isinstance(thing.base, np.ndarray) else thing.base
            total += root.nbytes if root is thing or id(root) not in seen else 0
            seen.add(id(root))
        elif isinstance(thing, dict):
            todo += thing.values()
        elif isinstance(thing, (list, tuple, set)):
            todo += thing
        elif is_dataclass(thing) and not isinstance(thing, type):
            todo += [getattr(thing, f.name) for f in fields(thing)]
        elif thing is owner or type(thing).__module__.startswith("core."):
            todo += vars(thing).values()
    return total


def growth_per_10k(samples: Sequence[Sample], figure: Callable[[Sample], int]) -> float:
    """Slope of a figure over the frames, by least squares, for 10 000 frames. Raises ValueError below two samples."""
    if len(samples) < 2:
        raise ValueError(f"{len(samples)} samples of memory: two at least are needed")
    x = np.array([s.frames for s in samples], np.float64)
    y = np.array([figure(s) for s in samples], np.float64)
    x -= x.mean()
    return float(1e4 * (x @ (y - y.mean())) / (x @ x))


def shots_of(
    sizes: Sequence[tuple[int, int]], kinds: Sequence[Kind] = KINDS, images: int = IMAGES
) -> list[FrameSequence]:
    """Return frame sequences of every kind at each size, except the slow ones; half of the kinds have more noise."""
    wanted = [k for k in kinds if k.name not in LEFT_OUT]
    return [kind_sequence(k, size, 0.005 if i % 2 else 0.0015, images) for size in sizes for i, k in enumerate(wanted)]


def table(samples: Sequence[Sample], rows: int = 20) -> str:
    """A Markdown table of some of the samples."""
    step = max(1, -(-len(samples) // rows))
    titles = ("frames", "resident, MB", "held by the extractor, MB", "blocks of Python", "in use, MB")
    lines = [
        (str(s.frames), f"{s.resident / 1e6:.1f}", f"{s.held / 1e6:.2f}", str(s.blocks), f"{s.in_use / 1e6:.2f}")
        for s in [*samples[:-1:step], samples[-1]]
    ]
    return markdown.table(titles, lines, words=0) + "\n"


def growth_words(samples: Sequence[Sample]) -> str:
    """What grew after warm-up, in a sentence."""
    resident = [s.resident for s in samples]
    return (
        f"After warm-up (every image at every attitude once) resident memory grew by "
        f"{growth_per_10k(samples, lambda s: s.resident) / 1e3:+.1f} kB per 10 000 frames, from {resident[0] / 1e6:.1f} to "
        f"{resident[-1] / 1e6:.1f} MB, {max(resident) / 1e6:.1f} MB at most; what the extractor holds by "
        f"{growth_per_10k(samples, lambda s: s.held) / 1e3:+.1f} kB, Python's blocks by {growth_per_10k(samples, lambda s: s.blocks):+.1f}."
    )


def main(arguments: list[str] | None = None) -> int:
    """Prints the table and the growth."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.speed.memory", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--frames", type=int, default=100_000, help="to be modelled (100000)")
    parser.add_argument("--every", type=int, help="frames between two samples (a hundredth of all)")
    args = parser.parse_args(arguments)
    every = args.every or max(1, args.frames // 100)
    if args.frames < 10 * every:
        parser.error("--frames: at least ten times --every")
    samples = measured(args.frames, every)
    print(f"{args.frames} frames: {MIX}\n\n{table(samples)}\n{growth_words(samples)}")
    return 0


def measured(frames: int, every: int) -> list[Sample]:
    """The samples of a run over the whole mix, with progress on stderr."""

    def tell(s: Sample) -> None:
        words = f"memory: {s.frames}/{frames} frames, {s.resident / 1e6:.1f} MB resident, {s.held / 1e6:.2f} MB held"
        print(words, file=sys.stderr, flush=True)

    small, large = shots_of(SIZES), shots_of([LARGE])
    print("memory: warming up", file=sys.stderr, flush=True)
    return watch(every_frame([*large, *small]), mixed_frames(small, large), frames, every, tell)


if __name__ == "__main__":
    sys.exit(main())
