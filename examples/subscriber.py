"""A minimal planner client. Run it beside the service: .venv/bin/python examples/subscriber.py [ADDRESS]"""

import argparse
import sys
from contextlib import suppress

from osape_client import Message, Subscriber


def on_message(message: Message) -> None:
    if message.stale or not message.valid:
        print(
            f"nothing may be taken as free: {message.cause or 'no newer message'} ({message.age_s:.1f} s old)",
            flush=True,
        )
        return
    space, at_m = message.space, message.vehicle_m
    if at_m is None:
        print("the message does not contain the position of the vehicle", flush=True)
        return
    print(f"{message.frame}, {1000 * message.age_s:.0f} ms old; nearest {space.nearest(at_m)[0][0]:.1f} m", end="")
    if message.frame == "level":  # x along the heading
        print(", ahead:", *space.segments([at_m], [[5, 0, 0]], radius_m=0.5), end="")
    print(flush=True)


parser = argparse.ArgumentParser(description="Prints what a planner may take as free.")
parser.add_argument("address", nargs="?", help="ipc://PATH or tcp://HOST:PORT (default: the service on this computer)")
try:
    with suppress(KeyboardInterrupt), Subscriber(parser.parse_args().address) as subscriber:  # Ctrl-C ends it
        while subscriber.wait(1.0) is None:
            why = subscriber.stats.last_error or "does the service run?"  # another service, stream or version
            print(f"no message on {subscriber.address}: nothing may be taken as free; {why}", flush=True)
        subscriber.subscribe(on_message)
except ValueError as error:  # an address that cannot be used
    sys.exit(str(error))
