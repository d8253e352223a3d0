"""Experiments with numbers: fidelity of the model on scenes with known truth, and what it is compared
with."""

from companion.kernels.jit_cache import use_own_cache

use_own_cache()  # before anything here imports numba: kernels of other sources must not be taken for these
