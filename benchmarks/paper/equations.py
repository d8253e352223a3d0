"""Equations 4-9, as they are printed: small experiments on columns of pixels, beside what they would have to be.

Nothing here calls the extractor: each formula is written out as it stands, so that it can be checked by hand. Symbols: x
disparity f C / Z; h total width of the kernel in x; n pixels of a column; Hm least height of an obstacle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.markdown import table
from benchmarks.paper.cases import NAN, Floats, number

F_PX, ROWS, HM_M, ALPHA = 450.0, 480, 0.6, 0.3
"""640x480 of ours, its rows, and constants that the paper does not give."""
KERNEL_SIGMA = 1.25 / 7.0
"""The Gaussian's sigma as a share of its total width: a bin and a quarter of seven."""
SIGMAS_WIDE = 5.6
"""Total width of the kernel in sigma of disparity: seven bins of 0.8."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A small table. rows: words (the first `words` columns) and numbers, shown with as many digits as `digits` says."""

    name: str
    title: str
    head: list[str]
    digits: list[int]
    rows: list[list[str | float]]
    words: int = 0

    def markdown(self) -> str:
        """The table."""
        lines = [
            [v if isinstance(v, str) else number(v, d) for v, d in zip(row, self.digits, strict=True)]
            for row in self.rows
        ]
        return table(self.head, lines, self.words)


def kernel(u: Floats) -> Floats:
    """Eq. 5 with the sigma above: a Gaussian of unit area on |u| < 1/2, 0 outside; 1/erf is its A."""
    a = 1.0 / math.erf(1.0 / (2.0 * math.sqrt(2.0) * KERNEL_SIGMA))
    value = a / (KERNEL_SIGMA * math.sqrt(2.0 * math.pi)) * np.exp(-0.5 * (u / KERNEL_SIGMA) ** 2)
    return np.where(np.abs(u) < 0.5, value, 0.0)


def density(x: Floats, values: Floats, h: float) -> Floats:
    """Eq. 4: the density at x (K,) of disparities (n,)."""
    return np.asarray(kernel((x[:, None] - values[None, :]) / h).sum(axis=1) / (len(values) * h))


def least_density(x: Floats, c: float, hm_m: float = HM_M) -> Floats:
    """Eq. 6: Hm x / C."""
    return hm_m * x / c


def least_height(c: float, ke_per_m: float, rows: int = ROWS) -> float:
    """Height in m of the least obstacle whose printed density reaches the printed threshold (it is the same at every
    distance): H f C/Z rows of it give H (x/C) K(0) / (n h), to be Hm x / C."""
    h = SIGMAS_WIDE * ke_per_m * F_PX * c
    return float(HM_M * rows * h / kernel(np.zeros(1))[0])


def units() -> Finding:
    """Eq. 4 against Eq. 6 over C: a wall of 4 m at 8 m that fills 225 of 480 rows, noise of ke = 0.0015."""
    ke, z = 0.0015, 8.0
    rng = np.random.Generator(np.random.PCG64(4))
    rows: list[list[str | float]] = []
    for c in (1.0, 0.1, 0.01, 0.00127, 0.0005):
        sigma = ke * F_PX * c
        wall = F_PX * c / z + sigma * rng.standard_normal(round(4.0 * F_PX / z))
        rest = np.full(ROWS - len(wall), -1.0)  # nothing near it
        h = SIGMAS_WIDE * sigma
        x = np.linspace(F_PX * c / z - h, F_PX * c / z + h, 201)
        f = density(x, np.concatenate([wall, rest]), h)
        at = int(np.argmax(f))
        found = bool((f > least_density(x, c)).any())
        rows.append(
            [c, float(f[at]), float(least_density(x[at : at + 1], c)[0]), "yes" if found else "no", least_height(c, ke)]
        )
    return Finding(
        name="units",
        title="Eq. 4 and 6: a density against a number of pixels",
        head=["C", "greatest F(x)", "F'(x) there", "wall found", "least height found, m"],
        digits=[5, 3, 1, 0, 2],
        rows=rows,
    )


def ground_onset_m(altitude_m: float, ke_per_m: float, seed: int = 0) -> tuple[float, float]:
    """(distance from which flat ground passes for an obstacle, by the formula f Hm / (h H); by counting a noisy column).

    A level camera; Eq. 4's sum of kernels, unnormalised, against Hm x, pixels with pixels. inf: never up to 60 m."""
    h = SIGMAS_WIDE * max(ke_per_m * F_PX, 0.1)
    expected = F_PX * HM_M / (h * altitude_m)
    rng = np.random.Generator(np.random.PCG64(seed))
    below = np.arange(1.0, 4.0 * ROWS)  # a tall image, so that near ground is in it
    exact = below / altitude_m
    distances = np.geomspace(1.0, 60.0, 160)
    x = F_PX / distances
    total = np.zeros(len(x))
    columns = 8
    for _ in range(columns):
        noisy = exact + ke_per_m * F_PX * rng.standard_normal(len(exact))
        total += kernel((x[:, None] - noisy[None, :]) / h).sum(axis=1)
    over = total / columns > HM_M * x
    return expected, float(distances[int(np.argmax(over))]) if over.any() else math.inf


def ground() -> Finding:
    """Where flat ground becomes an obstacle, by altitude and noise."""
    rows: list[list[str | float]] = []
    for ke in (0.0015, 0.005, 0.01):
        rows.append([ke])
        for altitude in (1.0, 2.0, 3.0, 5.0, 10.0):
            expected, counted = ground_onset_m(altitude, ke)
            rows[-1] += [expected, counted]
    head = ["ke, 1/m", *(f"{a:g} m: {what}" for a in (1.0, 2.0, 3.0, 5.0, 10.0) for what in ("formula", "counted"))]
    return Finding(
        name="ground",
        title="Eq. 6 over flat ground: distance in m from which it passes for an obstacle, by altitude (∞: not within 60 m)",
        head=head,
        digits=[4, *[1] * 10],
        rows=rows,
    )


def near_m(z_m: float, ke_per_m: float) -> float:
    """Eq. 8 as a distance: Z - ke Z^2, the least distance that noise leaves; not positive: no distance at all."""
    return z_m - ke_per_m * z_m * z_m


def nearest() -> Finding:
    """Eq. 8 over distance at the paper's ke."""
    ke = 0.01
    rows: list[list[str | float]] = []
    for z in (5.0, 10.0, 20.0, 50.0, 80.0, 95.0, 100.0, 110.0):
        near = near_m(z, ke)
        rows.append([z, near, F_PX / near if near > 0.0 else NAN, F_PX / max(near, z / 2.0)])
    return Finding(
        name="nearest",
        title="Eq. 7 and 8 at ke = 0.01: the window for Hs = 1 m",
        head=["Z, m", "nearest by Eq. 8, m", "window, px", "window with Z/2 as the least, px"],
        digits=[0, 2, 1, 1],
        rows=rows,
    )


def peak_width(values: Floats, h: float) -> float:
    """The paper's delta x: from where the density falls to alpha of its peak on one side to the same on the other."""
    x = np.linspace(values.min() - h, values.max() + h, 600)
    f = density(x, values, h)
    at = int(np.argmax(f))
    low = f[: at + 1] < ALPHA * f[at]
    high = f[at:] < ALPHA * f[at]
    first = at - int(np.argmax(low[::-1])) if low.any() else 0
    last = at + int(np.argmax(high)) if high.any() else len(x) - 1
    return float(x[last] - x[first])


def roughness_limit(z_m: float, ke_per_m: float, c: float, h: float, printed: bool) -> float:
    """Eq. 9's e(x): ke (C f / x)^2 + 2 alpha h as printed (ke Z^2, metres, plus a disparity), or with the noise as the
    disparity that it is, ke f C."""
    first = ke_per_m * z_m * z_m if printed else ke_per_m * F_PX * c
    return first + 2.0 * ALPHA * h


def roughness() -> Finding:
    """What Eq. 9 calls rough, over distance, for two values of C: a flat wall, and leaves 1.5 m deep; shares of columns.

    Last of each: noise as a disparity, and the factor 1.2 by which a peak must be wider."""
    ke, columns = 0.0015, 20
    rng = np.random.Generator(np.random.PCG64(9))
    rows: list[list[str | float]] = []
    for z in (3.0, 6.0, 10.0, 15.0, 20.0):
        count = round(min(ROWS, 4.0 * F_PX / z))
        row: list[str | float] = [z]
        for deep in (0.0, 1.5):
            called = np.zeros(3)
            for _ in range(columns):
                at = z + deep * (rng.random(count) - 0.5)
                unit = F_PX / at + ke * F_PX * rng.standard_normal(count)
                h = SIGMAS_WIDE * ke * F_PX
                spread = peak_width(unit, h)
                for i, (c, printed, factor) in enumerate(((1.0, True, 1.0), (0.1, True, 1.0), (1.0, False, 1.2))):
                    called[i] += c * spread > factor * roughness_limit(z, ke, c, c * h, printed)
            row += [100.0 * float(v) / columns for v in called]
        rows.append(row)
    head = ["Z, m"]
    head += [f"{what}: {how}" for what in ("wall", "leaves") for how in ("printed, C = 1", "printed, C = 0.1", "ours")]
    return Finding(
        name="roughness",
        title="Eq. 9: metres added to a disparity; columns called rough, %, at ke = 0.0015",
        head=head,
        digits=[0] * 7,
        rows=rows,
    )


def kth_nearest_m(disparity: Floats, share: float = 0.02, least: int = 3) -> float:
    """Distance of the k-th largest disparity (f = F_PX), k = max(least, share of the pixels)."""
    k = max(least, int(share * len(disparity)))
    return float(F_PX / np.sort(disparity)[-k])


def one_pixel() -> Finding:
    """A flat wall of 4 m by the largest disparity of its column (Eq. 9, rough), by the k-th largest and by the mean."""
    rng = np.random.Generator(np.random.PCG64(10))
    rows: list[list[str | float]] = []
    for ke in (0.0015, 0.005, 0.01):
        for z in (5.0, 10.0, 15.0):
            count = round(min(ROWS, 4.0 * F_PX / z))
            columns = F_PX / z + ke * F_PX * rng.standard_normal((400, count))
            most = np.median(F_PX / columns.max(axis=1))
            kth = np.median([kth_nearest_m(column) for column in columns])
            rows.append([ke, z, float(most), float(kth), float(np.median(F_PX / columns.mean(axis=1)))])
    return Finding(
        name="one_pixel",
        title="Eq. 9, rough: a wall where its nearest pixel is",
        head=["ke, 1/m", "true Z, m", "nearest pixel, m", "k-th nearest, m", "mean, m"],
        digits=[4, 0, 2, 2, 2],
        rows=rows,
    )


def findings() -> list[Finding]:
    """All experiments on Eq. 4-9."""
    return [units(), ground(), nearest(), roughness(), one_pixel()]
