"""What libraries print is collected, and nothing that is printed after them."""

from __future__ import annotations

import os
import sys

import pytest

from drivers.library_output import collected_output


def test_output_is_collected_within_the_block_only(capfd: pytest.CaptureFixture[str]) -> None:
    """Compiled code writes to the descriptor of stderr, not to `sys.stderr`."""
    with collected_output() as text:
        sys.stdout.write("of Python\n")
        os.write(2, b"of C\n")
    assert text.getvalue() == "of Python\nof C\n"
    sys.stderr.write("later\n")
    os.write(2, b"later of C\n")
    assert capfd.readouterr() == ("", "later\nlater of C\n")
