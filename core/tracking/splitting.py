"""Shortens and splits tracks whose cells have been removed."""

from __future__ import annotations

from ..jit import inner, kernel
from .tables import NONE, clear_cell, free_slot

_LEAST_M = 0.02
"""Least length of what is left of a track, which is lengthened to it."""


@kernel
def split_tracks(table, count, next_id, t_ns):
    """Shortens tracks whose ends have been removed, and splits those with a gap; the part observed most often keeps the id.
    The tracks are in the first `count` slots; a new part takes the first empty slot of the table, else that of the track not
    observed longest. Where this frame observed all others, the track stays whole: nothing of it was observed to be free but the
    gap.

    Returns (next id, end of the slots in use, tracks removed for want of slots)."""
    end, evicted = 0, 0
    for j in range(count):
        t = table.tracks[j]
        if t.hits == 0:
            continue
        best0, best1 = most_observed_run(table, j)
        if best0 == NONE:
            t.hits = 0
            continue
        begin, low, high = NONE, best0, best1
        for k in range(t.cells + 1):
            alive = k < t.cells and table.cells[j, k].hits > 0
            if alive and begin == NONE:
                begin = k
            if alive or begin == NONE:
                continue
            if begin != best0:
                other, gone = free_slot(table, t_ns)
                if other in (NONE, j):
                    low, high = min(low, begin), max(high, k)
                else:
                    copy_part(table, j, other, begin, k, next_id)
                    next_id, end = next_id + 1, max(end, other + 1)
                    evicted += 1 if gone else 0
            begin = NONE
        keep_part(table, j, low, high)
        end = max(end, j + 1)
        if t.s1_m - t.s0_m < _LEAST_M and t.seen_ns != t_ns:
            t.s0_m -= 0.5 * _LEAST_M
            t.s1_m += 0.5 * _LEAST_M
    return next_id, end, evicted


@inner
def most_observed_run(table, j):
    """(first cell, end) of the run of cells with the most observations; NONE: there is no cell."""
    t = table.tracks[j]
    best0, best1, best = NONE, NONE, 0
    begin, total = NONE, 0
    for k in range(t.cells + 1):
        hits = table.cells[j, k].hits if k < t.cells else 0
        if hits > 0:
            begin = k if begin == NONE else begin
            total += hits
        elif begin != NONE:
            if total > best:
                best0, best1, best = begin, k, total
            begin, total = NONE, 0
    return best0, best1


@inner
def keep_part(table, j, begin, end):
    """Limits slot j to its cells begin..end - 1."""
    t = table.tracks[j]
    low, high = (t.first_cell + begin) * t.cell_m, (t.first_cell + end) * t.cell_m
    t.s0_m, t.s1_m = max(t.s0_m, low), min(t.s1_m, high)
    if begin > 0:
        for k in range(begin, end):
            table.cells[j, k - begin] = table.cells[j, k]
    for k in range(end - begin, t.cells):
        clear_cell(table, j, k)
    t.first_cell += begin
    t.cells = end - begin
    if t.s1_m < t.s0_m:
        middle = 0.5 * (t.s0_m + t.s1_m)
        t.s0_m, t.s1_m = middle - 0.5 * _LEAST_M, middle + 0.5 * _LEAST_M


@inner
def copy_part(table, j, other, begin, end, track_id):
    """Gives the cells begin..end - 1 of slot j to the empty slot `other`, as a track of its own."""
    table.tracks[other] = table.tracks[j]
    t, o = table.tracks[j], table.tracks[other]
    o.id, o.merged_into = track_id, NONE
    most, newest = 0, 0
    for k in range(t.cells):
        table.cells[other, k] = table.cells[j, k]
        if begin <= k < end:
            most = max(most, table.cells[j, k].hits)
            newest = max(newest, table.cells[j, k].seen_ns)
    o.hits, o.seen_ns = max(1, most), newest
    keep_part(table, other, begin, end)
