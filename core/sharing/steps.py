"""Numbers in few bits: fine steps up to a limit, coarse steps beyond it, rounded up."""

from __future__ import annotations

import math
from dataclasses import dataclass

_TINY = 1e-9


@dataclass(frozen=True, slots=True)
class Steps:
    """Codes 0..fine_codes are multiples of `fine`; greater codes continue in steps of `coarse`. codes: number of
    codes."""

    codes: int
    fine_codes: int
    fine: float
    coarse: float

    def value(self, code: int) -> float:
        """Returns the value of a code."""
        return self.fine * min(code, self.fine_codes) + self.coarse * max(0, code - self.fine_codes)

    def code_up(self, value: float) -> int:
        """Returns the code of the least value that is not smaller; `codes` or more if there is none."""
        limit = self.fine * self.fine_codes
        if value <= limit:
            return max(0, math.ceil(value / self.fine - _TINY))
        return self.fine_codes + math.ceil((value - limit) / self.coarse - _TINY)


LONG_MARGIN_M = Steps(64, 32, 0.05, 0.25)
"""6 bits, up to 9.35 m."""
SHORT_MARGIN_M = Steps(32, 16, 0.05, 0.25)
"""5 bits, up to 4.55 m."""
LONG_HEIGHT_M = Steps(1024, 512, 0.1, 0.5)
"""10 bits, up to 306.7 m."""
SHORT_HEIGHT_M = Steps(128, 64, 0.1, 0.5)
"""7 bits, up to 37.9 m."""
LONG_AGES_S = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0, 2048.0, math.inf)
"""4 bits."""
SHORT_AGES_S = (0.25, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, math.inf)
"""3 bits."""


def age_code(age_s: float, ages_s: tuple[float, ...]) -> int:
    """Returns the code of the least age of a table that is not smaller."""
    return next(k for k, limit in enumerate(ages_s) if not age_s > limit)
