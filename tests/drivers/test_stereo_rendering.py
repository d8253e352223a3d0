"""Rendered image pairs: textures that both views share, sky at infinity, exposure, noise, glass, fog, dots."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.open_air.stereo_profiles import PROFILES
from benchmarks.open_air.stereo_scenes import STEREO_SCENES, make_stereo_scene
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.types import Intrinsics
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.stereo.exposure import Exposure, expose
from drivers.simulation.stereo.pair_renderer import (
    GlassPane,
    PairBrightness,
    StereoView,
    expose_pair,
    pair_brightness,
)
from drivers.simulation.stereo.shading import Light, Projector, Surfaces, radiance
from drivers.simulation.stereo.sky import CLEAR, CLOUDED, HAZY, LOW_SUN, Sky
from drivers.simulation.stereo.stereo_profiles import StereoCamera
from drivers.simulation.stereo.stereo_scene import surfaces_of
from drivers.simulation.stereo.textures import (
    ASPHALT,
    BLANK_PAINT,
    BLINDS,
    BRICK,
    GRASS,
    GRAVEL,
    LEAVES,
    PLASTER,
    Material,
)
from tests.nightly import nightly

K = Intrinsics(160, 96, 120.0, 120.0, 79.5, 47.5)
VIEW = StereoView(intrinsics=K, baseline_m=0.1)
R = rotation_from_euler(0.0, 0.0, 0.0) @ R_CAMFRD_OPTICAL
QUIET = Exposure(noise_grey=0.0, vignetting=0.0, right_gain=1.0)
AT = np.array([0.0, 0.0, -2.0])


def wall_of(material: Material, x_m: float = 3.0) -> Surfaces:
    """A wall across the view, square to it."""
    s = SceneBuilder("wall")
    s.wall("wall", (x_m, -40.0), (x_m, 40.0), 40.0, base=-10.0)
    return Surfaces(scene=s.build(), material_of=np.zeros(1, np.int32), materials=(material,))


def bright(surfaces: Surfaces, sky: Sky = CLEAR, panes: tuple[GlassPane, ...] = (), **light: object) -> PairBrightness:
    return pair_brightness(surfaces, panes, VIEW, R, AT, Light(sky=sky, **light))  # type: ignore[arg-type]


@pytest.mark.parametrize("material", [BRICK, PLASTER, GRASS, GRAVEL, LEAVES, ASPHALT, BLINDS])
def test_both_views_see_the_same_texture(material: Material) -> None:
    """A wall at 3 m has a disparity of 4 px: what differs after the shift is far below the contrast."""
    pair = expose_pair(bright(wall_of(material)), QUIET, 0)
    left, right = pair.left[:, 4:].astype(float), pair.right[:, :-4].astype(float)
    assert left.std() > 2.0
    assert (left - right).std() < 0.1 * left.std() + 0.5


def test_blank_paint_has_no_texture() -> None:
    assert expose_pair(bright(wall_of(BLANK_PAINT)), QUIET, 0).left.std() < 0.5


def test_a_finer_texture_than_the_pixels_fades_instead_of_aliasing() -> None:
    """At 100 m a pixel covers 0.8 m: waves of 5 cm are not seen."""
    fine = Material(albedo=0.4, contrast=0.5, coarse_m=0.05, fine_m=0.05)
    assert expose_pair(bright(wall_of(fine, 2.0)), QUIET, 0).left.std() > 5.0
    assert expose_pair(bright(wall_of(fine, 100.0)), QUIET, 0).left[35:55, 60:100].std() < 0.5


def grass() -> Surfaces:
    s = SceneBuilder("grass")
    s.ground()
    return Surfaces(scene=s.build(), material_of=np.zeros(1, np.int32), materials=(GRASS,))


def ground_band(R_ned_optical: np.ndarray, least_deg: float, most_deg: float) -> np.ndarray:
    """(H, W) pixels whose rays fall by so many degrees below the horizon."""
    v, u = np.mgrid[: K.height, : K.width]
    rays = np.stack([(u - K.cx) / K.fx, (v - K.cy) / K.fy, np.ones(u.shape)], axis=-1) @ R_ned_optical.T
    fall_deg = np.degrees(np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1])))
    return (fall_deg > least_deg) & (fall_deg < most_deg)


@pytest.mark.parametrize("roll_deg", [10.0, *nightly(0.0)])
def test_a_slanted_surface_is_averaged_over_each_pixel(roll_deg: float) -> None:
    """The mean of 8 x 8 rays in each pixel. At 2 degrees a pixel is 29 times as long as it is wide."""
    n = 8
    fine = Intrinsics(n * K.width, n * K.height, n * K.fx, n * K.fy, n * (K.cx + 0.5) - 0.5, n * (K.cy + 0.5) - 0.5)
    R_rolled = rotation_from_euler(np.radians(roll_deg), 0.0, 0.0) @ R_CAMFRD_OPTICAL
    rays, _ = radiance(grass(), fine, R_rolled, AT, Light(sky=CLEAR))
    mean = rays.reshape(K.height, n, K.width, n).mean(axis=(1, 3))
    left = pair_brightness(grass(), (), VIEW, R_rolled, AT, Light(sky=CLEAR)).left
    for least_deg, most_deg in ((2.0, 4.0), (4.0, 10.0)):
        band = ground_band(R_rolled, least_deg, most_deg)
        assert left[band].std() == pytest.approx(mean[band].std(), rel=0.15)
        assert np.corrcoef(left[band], mean[band])[0, 1] > 0.95


@pytest.mark.parametrize("roll_deg", [0.0, 10.0, -20.0])
def test_rolled_views_see_the_same_ground(roll_deg: float) -> None:
    """A row of the right view meets other places of the ground than that of the left one."""
    R_rolled = rotation_from_euler(np.radians(roll_deg), 0.0, 0.0) @ R_CAMFRD_OPTICAL
    view = replace(VIEW, baseline_m=0.5)
    b = pair_brightness(grass(), (), view, R_rolled, AT, Light(sky=CLEAR))
    v, u = np.mgrid[: K.height, : K.width].astype(np.float32)
    rays = np.stack([(u - K.cx) / K.fx, (v - K.cy) / K.fy, np.ones(u.shape)], axis=-1) @ R_rolled.T
    disparity = np.maximum(K.fx * view.baseline_m * rays[..., 2] / -AT[2], 0.0)
    right = cv2.remap(b.right, (u - disparity).astype(np.float32), v, cv2.INTER_CUBIC)
    band = ground_band(R_rolled, 2.0, 5.0) & (u - disparity > 2.0)
    assert np.corrcoef(b.left[band], right[band])[0, 1] > 0.95


EMPTY = surfaces_of(SceneBuilder("nothing").build())


@pytest.mark.parametrize("sky", [CLEAR, HAZY, CLOUDED])
def test_the_sky_is_at_infinity(sky: Sky) -> None:
    b = bright(EMPTY, sky)
    assert np.array_equal(b.left, b.right)


def test_clouds_have_contrast_along_a_row_and_a_clear_sky_has_not() -> None:
    above = np.s_[:40]
    clear, clouds = (bright(EMPTY, sky).left[above] for sky in (CLEAR, CLOUDED))
    assert np.ptp(clear, axis=1).max() < 0.05 * clear.mean()
    assert clouds.std(axis=1).mean() > 0.03 * clouds.mean()


def test_the_sun_saturates_where_it_stands() -> None:
    """14.3 degrees to the right, 17.2 up of the axis: 30.6 px and 37.2 px / cos of the azimuth."""
    image = expose_pair(bright(EMPTY, LOW_SUN), QUIET, 0).left
    v, u = np.argwhere(image == image.max()).mean(axis=0)
    assert image.max() == 255
    assert u == pytest.approx(79.5 + 120.0 * np.tan(0.25), abs=3.0)
    assert v == pytest.approx(47.5 - 120.0 * np.tan(0.3) / np.cos(0.25), abs=3.0)


@pytest.mark.parametrize("albedo", [0.05, 0.2, 0.8])
def test_automatic_exposure_reaches_its_target(albedo: float) -> None:
    image = expose_pair(bright(wall_of(Material(albedo=albedo, contrast=0.2))), QUIET, 0).left
    assert image.mean() == pytest.approx(0.45 * 255, rel=0.05)


@pytest.mark.parametrize("noise_grey", [0.5, 1.0, 1.5])
def test_the_noise_has_its_size_at_mid_grey_and_grows_with_the_light(noise_grey: float) -> None:
    exposure = replace(QUIET, noise_grey=noise_grey, gamma=1.0)

    def noise(level: float) -> float:
        rng = np.random.Generator(np.random.PCG64(1))
        light = np.full((200, 200), level / 255.0, np.float32)
        return float(expose(light, 1.0, exposure, rng).std())

    rounding = np.sqrt(noise_grey**2 + 1.0 / 12.0)
    assert noise(128.3) == pytest.approx(rounding, rel=0.04)
    assert noise(230.3) > 1.15 * noise(40.3)


def test_motion_blur_takes_the_contrast_along_the_motion() -> None:
    b = bright(wall_of(GRAVEL, 1.5))
    sharp = expose_pair(b, QUIET, 0).left.astype(float)
    moved = expose_pair(b, replace(QUIET, blur_px=(8.0, 0.0)), 0).left.astype(float)
    along = [np.abs(np.diff(image, axis=1)).mean() for image in (sharp, moved)]
    across = [np.abs(np.diff(image, axis=0)).mean() for image in (sharp, moved)]
    assert along[1] < 0.4 * along[0]
    assert across[1] > 1.5 * along[1]


def test_fog_takes_the_contrast() -> None:
    clear, fog = (bright(wall_of(BRICK), fog_per_m=k).left.std() for k in (0.0, 0.5))
    assert fog < 0.4 * clear


def test_projected_dots_give_texture_to_blank_paint_nearby_only() -> None:
    projector = Projector(offset_m=0.05, strength=2.0)
    view = replace(VIEW, exposure=QUIET)
    contrast = []
    for x in (1.0, 12.0):
        light = Light(sky=CLEAR, projector=projector)
        b = pair_brightness(wall_of(BLANK_PAINT, x), (), view, R, AT, light)
        contrast.append(float(b.left.std() / b.left.mean()))
    assert contrast[0] > 0.05
    assert contrast[1] < 0.01


def test_glass_shows_what_is_behind_and_mirrors_what_is_before() -> None:
    def image(tree: bool, wall: bool) -> np.ndarray:
        s = SceneBuilder("glass")
        s.ground()
        s.wall("glass", (4.0, -5.0), (4.0, 5.0), 6.0, thickness=0.02)
        if wall:
            s.box("house", 8.0, 0.0, 1.0, 2.0, 6.0)
        if tree:
            s.box("tree", -5.0, 0.0, 1.0, 2.0, 6.0)
        pane = GlassPane(
            name="glass", normal_ned=(-1.0, 0.0, 0.0), point_ned_m=(4.0, 0.0, 0.0), outside=("tree",) if tree else ()
        )
        return bright(surfaces_of(s.build()), panes=(pane,)).left

    plain = image(False, False)
    behind, mirrored = np.abs(image(False, True) - plain), np.abs(image(True, False) - plain)
    assert behind[30:60, 75:85].mean() > 0.05
    assert mirrored[30:60, 75:85].mean() > 0.02
    assert mirrored[30:60, :20].max() < 1e-6


def test_the_same_seed_gives_the_same_images_and_another_frame_other_noise() -> None:
    camera = StereoCamera(replace(PROFILES["zed"], view=VIEW))
    scene = make_stereo_scene("street", 3)
    one, same, other = (camera.pair(scene, R, AT, 3, frame) for frame in (0, 0, 1))
    assert np.array_equal(one.left, same.left)
    assert np.array_equal(one.right, same.right)
    assert 0.3 < (one.left.astype(float) - other.left).std() < 3.0


@pytest.mark.parametrize("name", STEREO_SCENES)
def test_every_scene_renders(name: str) -> None:
    scene = make_stereo_scene(name, 1)
    height = scene.stand_m + min(2.0, scene.highest_m)
    view = replace(VIEW, intrinsics=Intrinsics(64, 48, 48.0, 48.0, 31.5, 23.5))
    light = Light(sky=scene.sky, fog_per_m=scene.fog_per_m)
    b = pair_brightness(scene.surfaces, scene.panes, view, R, np.array([0.0, 0.0, -height]), light)
    assert np.isfinite(b.left).all()
    assert b.left.min() > 0.0
    assert set(scene.blank) <= set(scene.scene.names)


def test_names_that_do_not_exist_are_named() -> None:
    with pytest.raises(ValueError, match="no stereo scene 'meadow'; there are: field"):
        make_stereo_scene("meadow")
