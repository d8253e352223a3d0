"""Runs `companion` as `python -m companion`."""

import sys

from .entry import main

sys.exit(main())
