"""Experiments: accuracy of the model on scenes with known truth, speed, and comparison with other methods."""

from companion.kernels.jit_cache import use_own_cache

use_own_cache()  # must run before numba is imported: kernels of other sources must not be loaded
