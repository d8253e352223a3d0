"""What is broken at an instant of a flight."""

from __future__ import annotations

from dataclasses import dataclass, field

NS = 1_000_000_000
MS = 1_000_000


@dataclass(slots=True)
class Switches:
    """The state of each part that a fault can change. The defaults are those without a fault.

    Attributes:
        delivers: the camera delivers frames.
        repeats: the camera repeats its newest images, of this number in turn, with new stamps; 0: it does not.
        stamp_shift_ns: added to the stamps of the camera.
        frame_delay_ns: added to the delay of every second frame, so that frames arrive out of order.
        other_size: the images have another size.
        covered: share of the image's columns, from the left, that are not measured.
        unmeasured_share: share of the pixels, at random, that are not measured.
        noise_factor: by which the noise of the depth is greater than that of the camera.
        hides_attitude: no attitude is sent.
        attitude_gap_ns: least time between two attitudes.
        repeats_attitude: the same attitude is sent with advancing stamps.
        repeats_stamp: the same attitude is sent with the same stamp.
        negates: each second quaternion has the other sign, which is the same attitude.
        not_a_number: attitudes are not finite.
        link_up, link_down: messages of the autopilot arrive; it receives messages.
        delay_ns, jitter_ns: added to the delay of messages of the autopilot; at most jitter_ns, at random.
        lost_share: share of the autopilot's messages that are lost.
        copied_share, copy_delay_ns: share of its messages that arrive a second time, so much later.
        route_delay_ns: every second message, at random, takes another route, which needs so much longer.
        burst_ns: messages wait for the next multiple of this time; 0: they do not.
        request_delay_ns: added to the delay of messages to the autopilot.
        noise_share: share of its messages with a wrong byte.
        answer_delay_ns: added to the delay of answers to TIMESYNC.
        answer_shift_ns: added to the time in these answers.
        answer_scatter_ns: the same, at random in both directions.
        second_system_id: of a second autopilot on the line; 0: none.
        disarmed: the vehicle is disarmed and reports that it is on the ground: it is carried.
        stops_pipeline, stops_sender, stops_all: threads, or the process, that do not run.
        pipeline_ns: time that the pipeline needs for a frame.
        clock_rate: by which CLOCK_MONOTONIC is corrected, seconds per second."""

    delivers: bool = True
    repeats: int = 0
    stamp_shift_ns: int = 0
    frame_delay_ns: int = 0
    other_size: bool = False
    covered: float = 0.0
    unmeasured_share: float = 0.0
    noise_factor: float = 1.0
    hides_attitude: bool = False
    attitude_gap_ns: int = 0
    repeats_attitude: bool = False
    repeats_stamp: bool = False
    negates: bool = False
    not_a_number: bool = False
    link_up: bool = True
    link_down: bool = True
    delay_ns: int = 0
    jitter_ns: int = 0
    lost_share: float = 0.0
    copied_share: float = 0.0
    copy_delay_ns: int = 0
    route_delay_ns: int = 0
    burst_ns: int = 0
    request_delay_ns: int = 0
    noise_share: float = 0.0
    answer_delay_ns: int = 0
    answer_shift_ns: int = 0
    answer_scatter_ns: int = 0
    second_system_id: int = 0
    disarmed: bool = False
    stops_pipeline: bool = False
    stops_sender: bool = False
    stops_all: bool = False
    pipeline_ns: int = 0
    clock_rate: float = 0.0


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault between two instants of the flight.

    Attributes:
        name: of its kind.
        begin_ns, end_ns: the same for an event.
        changes: values of Switches.
        event: name of the method of the loop that is called at its beginning; empty: none.
        camera: number of the camera that it concerns; -1: all of them, or no camera.
        recovery_s: after its end, without another fault, the sectors must be seen again within this time."""

    name: str
    begin_ns: int
    end_ns: int
    changes: dict[str, float] = field(default_factory=dict)
    event: str = ""
    recovery_s: float = 1.5
    camera: int = -1


def switches_at(faults: list[Fault], flown_ns: int, camera: int = -1) -> Switches:
    """What is broken at an instant of the flight, for one camera, or for any part but a camera."""
    switches = Switches()
    for fault in faults:
        concerns = camera < 0 or fault.camera in (-1, camera)
        if concerns and fault.begin_ns <= flown_ns < fault.end_ns:
            for name, value in fault.changes.items():
                setattr(switches, name, value)
    return switches
