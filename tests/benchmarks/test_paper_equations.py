"""The paper's equations as they are printed, against figures that can be had by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.paper.equations import (
    F_PX,
    HM_M,
    Finding,
    density,
    ground_onset_m,
    kernel,
    kth_nearest_m,
    least_density,
    least_height,
    near_m,
    nearest,
    peak_width,
    roughness_limit,
)


def test_the_kernel_has_unit_area_and_ends_at_a_half() -> None:
    u = np.linspace(-1.0, 1.0, 20001)
    assert kernel(u).sum() * 1e-4 == pytest.approx(1.0, abs=1e-3)
    assert (kernel(np.array([0.5, -0.5, 0.7])) == 0.0).all()
    assert kernel(np.array([0.1]))[0] == kernel(np.array([-0.1]))[0] < kernel(np.zeros(1))[0]


def test_the_density_of_equal_values_peaks_there_and_has_unit_area() -> None:
    x = np.linspace(40.0, 60.0, 20001)
    f = density(x, np.full(7, 50.0), 4.0)
    assert x[np.argmax(f)] == pytest.approx(50.0)
    assert f.max() == pytest.approx(kernel(np.zeros(1))[0] / 4.0)
    assert f.sum() * 1e-3 == pytest.approx(1.0, abs=1e-3)  # a density, whatever the number of pixels


def test_the_least_height_reaches_the_threshold_exactly() -> None:
    c, ke, z = 0.01, 0.002, 8.0
    height = least_height(c, ke)
    h = 5.6 * ke * F_PX * c
    count = height * F_PX / z
    f = count * kernel(np.zeros(1))[0] / (480 * h)
    assert f == pytest.approx(least_density(np.array([F_PX * c / z]), c)[0])
    assert least_height(0.1, ke) == pytest.approx(10.0 * height)  # it hangs on C, which is free


def test_ground_is_counted_as_an_obstacle_according_to_the_formula() -> None:
    expected, counted = ground_onset_m(3.0, 0.005)
    assert expected == pytest.approx(F_PX * HM_M / (5.6 * 0.005 * F_PX * 3.0))
    assert counted == pytest.approx(expected, rel=0.1)
    assert ground_onset_m(6.0, 0.005)[0] == pytest.approx(expected / 2.0)


def test_the_nearest_distance_turns_back() -> None:
    assert near_m(10.0, 0.01) == pytest.approx(9.0)
    assert near_m(80.0, 0.01) == pytest.approx(near_m(20.0, 0.01))
    assert near_m(100.0, 0.01) == 0.0
    rows = {row[0]: row for row in nearest().rows}
    assert math.isnan(float(rows[100.0][2]))
    assert float(rows[80.0][2]) > float(rows[50.0][2])


def test_the_width_of_a_peak_is_where_it_falls_to_alpha() -> None:
    h = 7.0
    sigma = 1.25  # of the kernel, in the units of h
    expected = 2.0 * sigma * math.sqrt(2.0 * math.log(1.0 / 0.3))
    assert peak_width(np.full(5, 100.0), h) == pytest.approx(expected, abs=0.1)


def test_the_limit_of_roughness_adds_metres_to_a_disparity() -> None:
    assert roughness_limit(10.0, 0.002, 1.0, 3.0, printed=True) == pytest.approx(0.2 + 1.8)
    assert roughness_limit(10.0, 0.002, 1.0, 3.0, printed=False) == pytest.approx(0.9 + 1.8)
    # in other units of disparity the first share stays what it was
    assert roughness_limit(10.0, 0.002, 0.1, 0.3, printed=True) == pytest.approx(0.2 + 0.18)
    assert roughness_limit(10.0, 0.002, 0.1, 0.3, printed=False) == pytest.approx(0.1 * (0.9 + 1.8))


def test_the_kth_nearest_leaves_two_stray_pixels_out() -> None:
    disparity = np.concatenate([np.full(100, 45.0), [90.0, 200.0]])
    assert kth_nearest_m(disparity) == pytest.approx(10.0)
    assert kth_nearest_m(disparity, share=0.0, least=2) == pytest.approx(5.0)


def test_a_finding_shows_text_and_figures() -> None:
    shown = Finding(name="f", title="F", head=["a", "b"], digits=[0, 2], rows=[["x", 1.234], ["y", math.nan]], words=1)
    assert shown.markdown() == "| a | b |\n|---|---:|\n| x | 1.23 |\n| y | - |"
