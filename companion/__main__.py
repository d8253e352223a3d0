"""`python -m companion` is `companion`."""

import sys

from .cli import main

sys.exit(main())
