"""Zstandard for the chunks of a log, at the quickest where nothing is to be gained: noise does not compress.

The image of a stereo matcher is smooth and grows by a third or more at the quickest level; the noise of other cameras stays
almost as large at any below 0, and takes half of the time there. Which of them a camera gives is tried, now and then."""

from __future__ import annotations

from typing import Final

import zstandard

QUICKEST: Final = -7
"""The level for noise; those below it make noise larger too."""
MOST_GROWTH: Final = 1.03
"""Of a chunk at the quickest level, for it to be taken."""
TRIED_EVERY: Final = 64
"""Chunks: two images of 640x480 each, so 4 s at 30 Hz and 11 s at 12 Hz. To try takes 1 to 3 % more time."""


class ChunkCompressor:
    """One for each file: what it writes depends on what it was given alone. level: zstd's; at 0 and above, where size is asked
    for and not speed, and at QUICKEST and below it is the only one."""

    def __init__(self, level: int) -> None:
        self._asked = zstandard.ZstdCompressor(level=level)
        self._quickest = zstandard.ZstdCompressor(level=QUICKEST) if QUICKEST < level < 0 else None
        self._chosen = self._asked
        self._left = 0

    def compress(self, chunk: memoryview) -> bytes:
        """A frame of Zstandard that holds the chunk."""
        if self._quickest is None:
            return self._asked.compress(chunk)
        if self._left > 0:
            self._left -= 1
            return self._chosen.compress(chunk)
        asked, quickest = self._asked.compress(chunk), self._quickest.compress(chunk)
        quick = len(quickest) <= MOST_GROWTH * len(asked)
        self._chosen, self._left = (self._quickest if quick else self._asked), TRIED_EVERY - 1
        return quickest if quick else asked
