"""Slow, obvious oracles of the kernels: plain loops over the definitions, nothing shared with the code under test."""

from __future__ import annotations

import itertools
import math

import numpy as np

UNKNOWN, FAR = 0, 1
STAND_SIGMAS, STAND_M, LINE_SIGMAS, JUMP_SHARE, JUMP_SIGMAS, ROUGHNESS_M, LONG_WS = 6.0, 0.1, 3.0, 0.1, 3.0, 0.02, 0.5
TALL_GAPS = 3.0
"""Constants of the stages, written a second time."""


# ---- pixels -----------------------------------------------------------------------------------------------------


def pixel_kind(mm: int, min_m: float, max_m: float, ke: float) -> str:
    """'measured', 'far' or 'unknown' of one uint16 millimetre value."""
    if mm in (0, 65535):
        return "unknown"
    if mm == 65534 or mm / 1000.0 > max_m / (1.0 + 3.0 * ke * max_m):
        return "far"
    return "measured" if mm / 1000.0 >= min_m else "unknown"


def inverse_image(depth_mm: np.ndarray, min_m: float, max_m: float, ke: float) -> np.ndarray:
    """1/Z of measured pixels, 0 of unknown, -1 of far ones."""
    out = np.zeros(depth_mm.shape)
    for at, mm in np.ndenumerate(depth_mm):
        kind = pixel_kind(int(mm), min_m, max_m, ke)
        out[at] = 1000.0 / mm if kind == "measured" else (-1.0 if kind == "far" else 0.0)
    return out


def is_flying(inverse: np.ndarray, v: int, u: int, step: float) -> bool:
    """Whether a pixel lies between two opposite measured neighbours and more than `step` (1/m) from both."""
    rows, cols = inverse.shape
    for dv, du in ((0, 1), (1, 0)):
        if not (dv <= v < rows - dv and du <= u < cols - du):
            continue
        a, b, d = inverse[v - dv, u - du], inverse[v + dv, u + du], inverse[v, u]
        if a > 0 and b > 0 and min(a, b) + step < d < max(a, b) - step:
            return True
    return False


def is_slanted(inverse: np.ndarray, v: int, u: int, step: float) -> bool:
    """Whether each axis along which a pixel is flying has two measured pixels on one side that are in line with it, within
    `step` (1/m)."""
    rows, cols = inverse.shape
    d = inverse[v, u]
    for dv, du in ((0, 1), (1, 0)):
        if not (dv <= v < rows - dv and du <= u < cols - du):
            continue
        a, b = inverse[v - dv, u - du], inverse[v + dv, u + du]
        if not (a > 0 and b > 0 and min(a, b) + step < d < max(a, b) - step):
            continue
        in_line = False
        for sign, beside in ((-1, a), (1, b)):
            at = v + 2 * sign * dv, u + 2 * sign * du
            inside = 0 <= at[0] < rows and 0 <= at[1] < cols
            in_line |= bool(inside and inverse[at] > 0 and abs(inverse[at] - 2 * beside + d) <= step)
        if not in_line:
            return False
    return True


def alone(inverse: np.ndarray, v: int, u: int, step: float) -> bool | None:
    """Whether a pixel is farther than `step` (1/m) from each measured neighbour; None where it has fewer than three."""
    rows, cols = inverse.shape
    beside = [(v - 1, u), (v + 1, u), (v, u - 1), (v, u + 1)]
    near = [inverse[at] for at in beside if 0 <= at[0] < rows and 0 <= at[1] < cols and inverse[at] > 0]
    if inverse[v, u] <= 0 or len(near) < 3:
        return None
    return all(abs(d - inverse[v, u]) > step for d in near)


def bends(mm: np.ndarray, focal_px: float, least_m: float, step: int) -> list[float]:
    """|Second differences| of disparity in px along the rows of a part of an image, their middle beyond least_m."""
    out = []
    for row in mm:
        for u in range(step, len(row) - step):
            a, b, c = (int(row[w]) for w in (u - step, u, u + step))
            if min(a, b, c) > 0 and max(a, b, c) < 65534 and b > 1000 * least_m:
                out.append(abs(1000 / a - 2000 / b + 1000 / c) * focal_px)
    return out


# ---- levelling --------------------------------------------------------------------------------------------------


def source_pixel(u, v, R, k, f, cu, cv):
    """(x, y, Z_optical / X) of the source pixel that cell (u, v) looks at, unrounded; None behind the camera."""
    ray = R.T @ np.array([1.0, (u - cu) / f, (v - cv) / f])
    if ray[2] <= 1e-3:
        return None
    return k.fx * ray[0] / ray[2] + k.cx, k.fy * ray[1] / ray[2] + k.cy, ray[2]


def own_cell(x, y, R, k, f, cu, cv):
    """(u, v, X / Z_optical) of the cell that source pixel (x, y) falls into, unrounded; None behind the camera."""
    ray = R @ np.array([(x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0])
    if ray[0] < 1e-3:
        return None
    return f * ray[1] / ray[0] + cu, f * ray[2] / ray[0] + cv, ray[0]


def near_half(*values: float) -> bool:
    """Whether rounding one of the values is a matter of the last digits."""
    return any(abs(abs(value - math.floor(value)) - 0.5) < 2e-3 for value in values)


def code_of(inverse: float, per_forward: float, gain: float) -> int:
    """Code of one measurement: disparity f/X in quanta; per_forward: Z_optical / X."""
    return int(min(max(round(inverse * per_forward * gain), 2), 65535))


# ---- density ----------------------------------------------------------------------------------------------------


def peaks(counts, threshold, share):
    """Bins of the peaks, near (high) to far: local maxima, neighbours joined while the valley is above share of the
    smaller; the highest valley, relative to its smaller peak, goes first."""
    padded = np.concatenate([[-1], counts, [-1]])
    tops = []
    for b in range(len(counts)):
        left = b
        while left > 0 and counts[left - 1] == counts[b]:
            left -= 1
        right = b
        while right < len(counts) - 1 and counts[right + 1] == counts[b]:
            right += 1
        if b == right and padded[left] < counts[b] > padded[right + 2]:
            tops.append(b)
    while len(tops) > 1:
        ratio = [min(counts[a : b + 1]) / min(counts[a], counts[b]) for a, b in itertools.pairwise(tops)]
        best = int(np.argmax(ratio))
        if ratio[best] < share:
            break
        tops.pop(best if counts[tops[best]] < counts[tops[best + 1]] else best + 1)
    return [b for b in reversed(tops) if counts[b] >= threshold[b] and counts[b] > 0]


# ---- strips -----------------------------------------------------------------------------------------------------


def mask_open_rows(line, gate, shift, tan_mid):
    """Rows with a measurement that is neither ground nor below it."""
    return [v for v in range(len(line)) if line[v] > FAR and not tan_mid[v] - shift > gate[line[v]]]


def stands_out(codes, first, last, tan_mid, shift, ground, ke, f, quantum, p):
    """Whether the rows first..last of a column lie before the ground by more than its noise, added up. ground: height
    and slope along x; shift: the slope across, at this column."""
    height, slope_x = ground
    sigma = max(ke * f, p.min_sigma_px)
    off = []
    for v in range(first, last + 1):
        seen = codes[v] / quantum
        if codes[v] == 0:
            continue
        flat = max(0.0, f * (tan_mid[v] - slope_x - shift) / height)
        off.append(-sigma if codes[v] == 1 else seen - flat * (1.0 + STAND_M / height))
    return sum(off) >= STAND_SIGMAS * sigma * math.sqrt(len(off))


def bands(code, members, high, tolerance):
    """(first row, number of pixels, sum of codes) of each part of a run: a part ends before two bands in a row whose mean
    is off that of the part by more than tolerance(mean code of the part, pixels of the band, of the part)."""
    top, parts, held = min(members), [], []
    for start in range(top, max(members) + 1, high):
        band = [v for v in range(start, start + high) if v in members]
        if not band:
            continue
        if not parts:
            parts = [[start, band]]
            continue
        own = parts[-1][1]
        mean = np.mean([float(code[v]) for v in own])
        if abs(np.mean([float(code[v]) for v in band]) - mean) <= tolerance(mean, len(band), len(own)):
            own += held + band
            held = []
        elif not held:
            held, held_start = band, start
        else:
            parts.append([held_start, held + band])
            held = []
    parts[-1][1].extend(held)
    return [(start, len(rows), sum(int(code[v]) for v in rows)) for start, rows in parts]


def missed(members, gap):
    """Rows in gaps of more than `gap` rows between members."""
    rows = sorted(members)
    return sum(b - a - 1 for a, b in itertools.pairwise(rows) if b - a - 1 > gap)


def accepted_segments(code, is_open, is_member, low, high, half, majority, need):
    """(top, bottom) rows of the runs of accepted windows of 2 x half rows, half a window apart."""
    rows = [v for v in range(len(code)) if is_member[v]]
    if not rows:
        return []
    first, last = rows[0], rows[-1]
    starts = list(range(first, last + 1, half))
    good = []
    for start in starts:
        inside = [v for v in range(start, min(last, start + 2 * half - 1) + 1) if is_open[v]]
        members = sum(bool(is_member[v]) for v in inside)
        mean = np.mean([float(code[v]) for v in inside]) if inside else -1.0
        good.append(members >= need and members > majority * len(inside) and low <= mean <= high)
    segments, v = [], 0
    while v < len(starts):
        if not good[v]:
            v += 1
            continue
        end = v
        while end + 1 < len(starts) and good[end + 1]:
            end += 1
        a, b = starts[v], min(last, starts[end] + 2 * half - 1)
        inside = [w for w in range(a, b + 1) if is_member[w]]
        segments.append((inside[0], inside[-1]))
        v = end + 1
    return segments


def irregular_segments(disparity, is_open, f, gap, tall_m, deep_m, noise_px):
    """(top, bottom) rows of the irregular rest of one column."""
    out, rows = [], []
    for v in range(len(disparity)):
        if not is_open[v]:
            continue
        if rows:
            new = [disparity[w] for w in [*rows, v]]
            jump = abs(disparity[v] - disparity[rows[-1]]) > max(noise_px, 0.08 * disparity[v])
            allowed = deep_m + noise_px * f / min(new) ** 2
            deep = f / min(new) - f / max(new) > allowed
            tall = v - rows[0] + 1 > tall_m * max(new)
            if v - rows[-1] > gap or jump or deep or tall:
                out.append((rows[0], rows[-1]))
                rows = []
        rows.append(v)
    return [*out, (rows[0], rows[-1])] if rows else out


def carried(strips, i, sigma_d, least, p):
    """Whether strip i of [(u, top, bottom, support, disparity)] stays: by itself, or by small neighbours."""
    alike = max(p.support_sigmas * sigma_d, p.support_relative * strips[i][4])
    u, top, bottom, support, d = strips[i]
    if support >= least:
        return True
    total = support
    for j, (w, t, b, s, e) in enumerate(strips):
        rows_apart = max(t - bottom, top - b)
        rows_free = p.support_rows + abs(w - u)
        if j == i or abs(w - u) > p.support_columns or rows_apart > rows_free or abs(e - d) > alike:
            continue
        inside = top >= t - 1 and bottom <= b + 1
        large = s >= p.support_large * least
        if inside and large and abs(w - u) <= 1 and abs(e - d) <= p.support_tail_sigmas * sigma_d:
            return False
        if not (inside and large):
            total += s
    return total >= least


# ---- clusters ---------------------------------------------------------------------------------------------------


def components(place, ws, hs):
    """Cluster of each strip (x, y, top, bottom): components of the graph of all pairs nearer than Ws and Hs."""
    n = len(place)
    label = list(range(n))
    for i in range(n):
        for j in range(i):
            (x, y, t, b), (p, q, r, s) = place[i], place[j]
            if math.hypot(x - p, y - q) < ws and max(t - s, r - b) < hs:
                old, new = max(label[i], label[j]), min(label[i], label[j])
                label = [new if k == old else k for k in label]
    return label


# ---- evidence ---------------------------------------------------------------------------------------------------


def uncovered_share(rect, a, b, p, q, behind_m, noise_s, gap_m, slack_m, grid, frame, mask):
    """Share of the empty cells of a rectangle (t0, t1, top, bottom) on s = a + b t; 2 with too large a square of them, too
    tall an area of them behind all of which something was measured, or an open one that neither p nor q has; mask: open cells at
    its distance, the same grid."""
    across, down, cu, cv = frame
    inside, empty = {}, set()
    for i, j in itertools.product(*map(range, grid.shape)):
        t, m = (i + 0.5 - cu) / across, (j + 0.5 - cv) / down
        s = a + b * t
        if rect[0] <= t < rect[1] and rect[2] * s <= m < rect[3] * s:
            inside[i, j] = t, m / s, s
            if grid[i, j] < 1.0 / (1.0 / s + behind_m) - noise_s:
                empty.add((i, j))
    for i, j in empty:
        t, z, s = inside[i, j]
        side = 1 + int(gap_m * min(across, down) * s)
        if all((i - di, j - dj) in empty for di in range(side) for dj in range(side)):
            return 2.0
        wide, high = 1 + int(0.5 * gap_m * min(across, down) * s), 1 + int(TALL_GAPS * gap_m * min(across, down) * s)
        area = [(i - di, j - d) for di in range(wide) for d in range(high)]
        if empty.issuperset(area) and all(grid[cell] > 0.0 for cell in area):
            return 2.0
        columns, rows = {k for k, _ in inside}, {r for k, r in inside if k == i}
        rim = min(i - min(columns), max(columns) - i, j - min(rows), max(rows) - j) + 0.5
        had = any(r[0] <= t <= r[1] and r[2] <= z <= r[3] for r in (p, q))
        if mask[i, j] and not had and rim > slack_m * down * s:
            return 2.0
    return len(empty) / max(1, len(inside))


# ---- standouts --------------------------------------------------------------------------------------------------


def least_excess(strips, share, spared_m, spreads, spread_m):
    """Excess from which strips, (excess, support) each, leave their plane: the least step of 5 cm that few enough reach."""
    everything = sum(support for _, support in strips)
    fits = [
        step
        for step in range(32)
        if sum(support for excess, support in strips if excess > 0 and excess >= 0.05 * step) <= share * everything
    ]
    worth = fits and max(e for e, _ in strips) - 0.05 * fits[0] >= max(spared_m, spreads * spread_m)
    return 0.05 * fits[0] if worth else math.inf


def runs(strips, link, meets):
    """Groups of indices of strips (u, top, bottom, plane) that leave: each goes on with the latest group out of its own
    plane whose last one it touches within link columns and `meets`."""
    groups = []
    for i, (u, top, bottom, plane) in enumerate(strips):
        for group in reversed(groups):
            v, a, b, q = strips[group[-1]]
            if q == plane and u - v <= link and top <= b + 1 and a <= bottom + 1 and meets(i, group[-1]):
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def tracks(strips, p, f):
    """Number of the track of each strip (u, top, bottom, t, d, sigma, cluster, cut, z0, z1), in order of columns:
    the one out of all tracks of its cluster that it fits best, of equals the oldest. No opening is anywhere."""
    found, numbers = [], []
    for strip in strips:
        costs = [_misfit_of(strip, track, p, f) for track in found]
        best = int(np.argmin(costs)) if costs else 0
        if not costs or costs[best] >= 1.0:
            best = len(found)
            found.append([])
        found[best].append(strip)
        numbers.append(best)
    return numbers


def _misfit_of(strip, track, p, f):
    """Misfit of a strip to the line of a track, over what is allowed; infinite where it cannot go on with it."""
    u, top, bottom, t, d, sigma, cluster, _, _, _ = strip
    last = track[-1]
    together = [*track, strip]
    tops, bottoms = [s[8] for s in together], [s[9] for s in together]
    ends = [s[8] for s in together if not s[7] & 1], [s[9] for s in together if not s[7] & 2]
    if (
        not 0 < u - last[0] <= p.link_gap_px
        or top > last[2]
        or last[1] > bottom
        or cluster != last[6]
        or abs(d - last[4]) > JUMP_SHARE * d + JUMP_SIGMAS * math.hypot(sigma, last[5])
        or max(ends[0], default=-math.inf) - min(tops) > p.height_step_m
        or max(bottoms) - min(ends[1], default=math.inf) > p.height_step_m
    ):
        return math.inf
    s = np.array([q[4] for q in track]) / f
    at = np.array([q[3] for q in track])
    w = np.array([1.0 / ((q[5] / f) ** 2 + (ROUGHNESS_M * (q[4] / f) ** 2) ** 2) for q in track])
    prior = p.link_slope_px**-2
    mean = np.average(at, weights=w)
    scatter = np.sum(w * (at - mean) ** 2) + prior
    b = np.sum(w * (at - mean) * (s - np.average(s, weights=w))) / scatter
    now = d / f
    variance = (sigma / f) ** 2 + (ROUGHNESS_M * now**2) ** 2 + 1.0 / np.sum(w) + (t - mean) ** 2 / scatter
    off = abs(now - np.average(s, weights=w) - b * (t - mean))
    return off / (p.line_tolerance_m * now**2 + LINE_SIGMAS * math.sqrt(variance))


# ---- free space -------------------------------------------------------------------------------------------------


def pair_cost(pieces, p, sigma_s, gap_m):
    """Cost of one line for two pieces (points (t, s, weight), their own line (a, b), front_m); 2 where refused.

    p: Params with merge_noise_cap = 0; sigma_s: noise of the least strip. Ends of a piece: its first and last point."""
    t, s, w = np.concatenate([points for points, _, _ in pieces]).T
    mean = np.average(t, weights=w)
    off = t - mean
    b = np.sum(w * off * (s - np.average(s, weights=w))) / (np.sum(w * off**2) + p.link_slope_px**-2)
    a = np.average(s, weights=w) - b * mean
    at = a + b * mean
    ends = [(points[:, 0].min(), points[:, 0].max()) for points, _, _ in pieces]
    if min(a + b * e for pair in ends for e in pair) < 0.5 * at:
        return 2.0
    (left0, left1), (right0, right1) = ends
    t0, t1 = min(left1, right1), max(left0, right0)
    x0, x1 = 1 / (a + b * t0), 1 / (a + b * t1)
    if t0 < t1 and math.hypot(x0 - x1, x0 * t0 - x1 * t1) > gap_m:
        return 2.0
    long = LONG_WS * p.passable_width_m * at
    turn = abs(np.subtract(*(math.atan2(slope, first) for _, (first, slope), _ in pieces)))
    if min(left1 - left0, right1 - right0) > long and turn > math.radians(p.plane_angle_deg):
        return 2.0
    worst, shift = 0.0, 0.0
    for (points, own, front), pair in zip(pieces, ends, strict=True):
        t_k, _, w_k = points.T
        allowed = p.merge_distance_m * (own[0] + own[1] * np.average(t_k, weights=w_k)) ** 2
        worst = max(worst, math.sqrt(np.average((a + b * t_k - own[0] - own[1] * t_k) ** 2, weights=w_k)) / allowed)
        shift = max(shift, front + max(1 / (a + b * e) - 1 / (own[0] + own[1] * e) for e in pair))
    weightier = max(pieces, key=lambda piece: piece[0][:, 2].sum())
    moved = (shift - max(0.0, weightier[2])) * at**2 / (p.merge_shift_m * at**2 + sigma_s)
    spread = math.sqrt(np.average((s - a - b * t) ** 2, weights=w)) / (p.merge_spread_m * at**2 + sigma_s)
    return 2.0 if max(worst, moved) >= 1.0 else max(0.0, worst, moved, spread)


def layer_cuts(tops, bottoms, join):
    """Cuts of a cluster: sorted ends, those within join of the first of a group being one."""
    ends = sorted([(float(z), "top") for z in tops] + [(float(z), "bottom") for z in bottoms], key=lambda e: e[0])
    groups: list[list[tuple[float, str]]] = []
    for end in ends:
        if groups and end[0] - groups[-1][0][0] <= join:
            groups[-1].append(end)
        else:
            groups.append([end])
    return [min(z for z, _ in g) if any(kind == "top" for _, kind in g) else max(z for z, _ in g) for g in groups]


def turned(points, cos, sin, shift_m):
    """(N, 2) float32 points turned and shifted, one by one, in double precision."""
    moved = [
        (cos * float(x) - sin * float(y) + shift_m[0], sin * float(x) + cos * float(y) + shift_m[1]) for x, y in points
    ]
    return np.array(moved, np.float64).astype(np.float32).reshape(-1, 2)
