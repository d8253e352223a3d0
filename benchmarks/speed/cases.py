"""The measured frames: kinds, sizes, noise, and scenes with an increasing number of objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes.catalogue import HELD_OUT_SEEDS, camera_pose, make_scene
from companion.bench.frames import HEIGHT_M, Depth, FrameSequence, render_sequence
from drivers.simulation.scenes import Scene, SceneBuilder

SIZES = ((320, 240), (640, 480), (1280, 800))
SIZE = (640, 480)
KE_PER_M = (0.0015, 0.005)
TILT_DEG = 20.0
SEED = HELD_OUT_SEEDS[0]
NEAREST_MM, MAX_MM = 300, 20000


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of frame. family: "structured", "foliage" or "broken" (images that a fault of the camera makes);
    spoil(depth, rng): what becomes of each image."""

    name: str
    family: str
    scene: str = "street"
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    spoil: Callable[[Depth, np.random.Generator], Depth] | None = None

    @property
    def level(self) -> bool:
        """Whether the camera looks straight ahead."""
        return self.roll_deg == 0.0 and self.pitch_deg == 0.0


def noise(depth: Depth, rng: np.random.Generator) -> Depth:
    """Every pixel at random between the nearest and the farthest distance."""
    return rng.integers(NEAREST_MM, MAX_MM, depth.shape, np.uint16)


def block_noise(depth: Depth, rng: np.random.Generator, side: int = 2) -> Depth:
    """As noise, but in blocks of side x side pixels, as a matcher's windows make it."""
    height, width = depth.shape
    coarse = rng.integers(NEAREST_MM, MAX_MM, (-(-height // side), -(-width // side)), np.uint16)
    return np.ascontiguousarray(np.kron(coarse, np.ones((side, side), np.uint16))[:height, :width])


def noise_in_a_tenth(depth: Depth, rng: np.random.Generator) -> Depth:
    """One rectangle of a tenth of the image is noise."""
    height, width = depth.shape
    rows, columns = round(height * 0.1**0.5), round(width * 0.1**0.5)
    top, left = int(rng.integers(0, height - rows)), int(rng.integers(0, width - columns))
    out = depth.copy()
    out[top : top + rows, left : left + columns] = noise(out[top : top + rows, left : left + columns], rng)
    return out


def noise_on_every_tenth(depth: Depth, rng: np.random.Generator) -> Depth:
    """A tenth of the pixels, anywhere, is noise."""
    return np.where(rng.random(depth.shape) < 0.1, noise(depth, rng), depth)


def nothing(depth: Depth, rng: np.random.Generator) -> Depth:
    """No pixel is measured."""
    return np.zeros_like(depth)


KINDS = (
    Kind(name="street, level", family="structured"),
    Kind(name="street, rolled", family="structured", roll_deg=TILT_DEG),
    Kind(name="street, pitched down", family="structured", pitch_deg=-TILT_DEG),
    Kind(name="trees, level", family="foliage", scene="trees"),
    Kind(name="trees, rolled", family="foliage", scene="trees", roll_deg=TILT_DEG),
    Kind(name="trees, pitched down", family="foliage", scene="trees", pitch_deg=-TILT_DEG),
    Kind(name="noise in a tenth, one block", family="broken", spoil=noise_in_a_tenth),
    Kind(name="noise on a tenth, scattered", family="broken", spoil=noise_on_every_tenth),
    Kind(name="noise everywhere", family="broken", spoil=noise),
    Kind(name="noise everywhere, 2x2 blocks", family="broken", spoil=block_noise),
    Kind(name="nothing measured", family="broken", spoil=nothing),
)


def kind_sequence(kind: Kind, size: tuple[int, int], ke_per_m: float, images: int) -> FrameSequence:
    """Images of a kind, from where the held-out seed puts the camera."""
    shot = scene_sequence(kind.scene, size, ke_per_m, images, kind.roll_deg, kind.pitch_deg)
    if kind.spoil is None:
        return replace(shot, name=kind.name)
    rng = np.random.Generator(np.random.PCG64(SEED))
    return replace(shot, name=kind.name, depth_mm=tuple(kind.spoil(image, rng) for image in shot.depth_mm))


def scene_sequence(
    scene: str, size: tuple[int, int], ke_per_m: float, images: int, roll_deg: float = 0.0, pitch_deg: float = 0.0
) -> FrameSequence:
    """Images of a scene of benchmarks.scenes.catalogue, made and seen as the held-out seed has it."""
    position, yaw = camera_pose(scene, SEED, HEIGHT_M)
    return render_sequence(
        scene,
        make_scene(scene, SEED),
        size,
        roll_deg=roll_deg,
        pitch_deg=pitch_deg,
        yaw_rad=yaw,
        position_ned_m=position,
        ke_per_m=ke_per_m,
        images=images,
        seed=SEED,
    )


def crowd(things: int, foliage: bool) -> Scene:
    """A field with a number of objects in view: boxes and poles, or small trees of 60 leaves."""
    rng = np.random.Generator(np.random.PCG64([SEED, things]))
    s = SceneBuilder("crowd", structured=not foliage)
    s.ground()
    for i in range(things):
        x, y = _place(rng)
        if foliage:
            s.tree(f"tree {i}", x, y, rng.uniform(2.5, 5.0), rng.uniform(0.7, 1.4), 60, rng)
        elif i % 2:
            s.pole(f"pole {i}", x, y, rng.uniform(0.1, 0.3), rng.uniform(2.0, 6.0))
        else:
            length, width, height, yaw = rng.uniform((0.5, 0.5, 1.0, 0.0), (2.0, 2.0, 4.0, 3.0))
            s.box(f"box {i}", x, y, length, width, height, yaw)
    return s.build()


def _place(rng: np.random.Generator) -> NDArray[np.float64]:
    """(2,) north and east of something in view, as often near as far."""
    x = rng.uniform(4.0, 18.0)
    return np.array([x, rng.uniform(-0.7, 0.7) * x])
