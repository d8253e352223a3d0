"""Stamps of an OAK whose device moves its clock against the host's: real messages of depthai, without a device."""

from __future__ import annotations

from datetime import timedelta

import depthai as dai
import pytest

from drivers.base import BadData
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings

from .oak_host import DEVICE_ALONE, HostLink, depth_message, now

pytestmark = pytest.mark.process

SETTINGS = OakSettings(camera="front", match=DEVICE_ALONE, first_frame_s=60.0)
PERIOD_S = 0.05
BOOTED = now() - timedelta(seconds=30)
BEFORE = 20


def stamped(jump_ms: float, states_own: bool = True, booted: timedelta = BOOTED) -> HostLink:
    """A device whose stamps on the host's clock jump after some frames, and go on advancing."""

    def make(number: int) -> dai.ImgFrame:
        exposed = now() - timedelta(milliseconds=60)
        jumped = timedelta(milliseconds=jump_ms if number >= BEFORE else 0.0)
        message = depth_message(number, stamp=exposed + jumped)
        if states_own:
            message.setTimestampDevice(exposed - booted)
        return message

    return HostLink(make, PERIOD_S)


def read_past_the_jump(source: OakSource) -> None:
    """Reads on for ten frames after it. The exposure must advance: an older frame would be dropped anyway."""
    source.open()
    last_ns = 0
    try:
        while (frame := source.read(60.0)) is not None and frame.sequence < BEFORE + 10:
            assert frame.t_exposure_ns > last_ns
            last_ns = frame.t_exposure_ns
    finally:
        source.close()


@pytest.mark.parametrize("jump_ms", [-30.0, 30.0])
def test_stamps_that_jump_against_the_device_s_own_clock_are_refused(jump_ms: float) -> None:
    """Their attitude is that of another instant: 3 degrees at 100 degrees a second, and no frame is older than the one before."""
    with pytest.raises(BadData, match=r"camera front: its stamps jumped by 30 ms .* own clock.* use a USB 3 port"):
        read_past_the_jump(OakSource(SETTINGS, stamped(jump_ms)))


def test_small_corrections_are_usual() -> None:
    """0.2 to 0.5 ms are documented, some milliseconds have been reported."""
    read_past_the_jump(OakSource(SETTINGS, stamped(-4.0)))


def test_a_device_that_does_not_state_its_own_clock_is_not_compared() -> None:
    read_past_the_jump(OakSource(SETTINGS, stamped(-30.0, states_own=False)))


def test_a_device_that_is_opened_again_has_a_new_clock() -> None:
    links = iter([stamped(0.0), stamped(0.0, booted=BOOTED + timedelta(seconds=20))])
    source = OakSource(SETTINGS, lambda settings: next(links))
    source.open()
    assert source.read(60.0) is not None
    source.close()
    read_past_the_jump(source)
