"""A minimal planner client. Run it beside the service: .venv/bin/python examples/subscriber.py [ADDRESS]"""

import sys
from contextlib import suppress

from osape_client import Message, Subscriber


def on_message(message: Message) -> None:
    if message.stale or not message.valid:
        print(f"nothing may be taken as free: {message.cause or 'no message'} ({message.age_s:.1f} s old)", flush=True)
        return
    space, at_m = message.space, message.vehicle_m
    if at_m is None:
        print("the message does not contain the position of the vehicle", flush=True)
        return
    ahead = space.segments([at_m], [[5, 0, 0]], radius_m=0.5) if message.frame == "level" else []  # x along the heading
    print(
        f"{message.frame}, {1000 * message.age_s:.0f} ms old; nearest {space.nearest(at_m)[0][0]:.1f} m",
        *ahead,
        flush=True,
    )


with suppress(KeyboardInterrupt), Subscriber(*sys.argv[1:]) as subscriber:  # Ctrl-C ends it
    subscriber.subscribe(on_message)
