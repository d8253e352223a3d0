"""What each published message states about its sending: the boot of the computer, the number and the age of the exposure."""

from __future__ import annotations

from drivers.suspended_time import LEAST_NS, suspended_ns
from osape_client.proto import osape_v1_pb2 as pb

READINGS = 5


class PublicationStamps:
    """Makes the field `publication` of messages. boot: identifier of this boot; start_ns: start of the service by the monotonic
    clock. Make it when the service starts: ages contain the time for which the computer was suspended since then."""

    def __init__(self, boot: str, start_ns: int = 0) -> None:
        self.boot, self._start_ns = boot, start_ns
        # a pause of this process makes a reading less, and all later ages greater
        self._suspended_ns = max(suspended_ns() for _ in range(READINGS))

    def stamp(self, number: int, age_ns: int) -> pb.Publication:
        """Returns the field. number: of the message; age_ns: of its exposure, by the monotonic clock."""
        since_start_ns = suspended_ns() - self._suspended_ns
        if since_start_ns >= LEAST_NS:
            age_ns += since_start_ns
        return pb.Publication(
            boot_id=self.boot,
            number=number,
            age_ns=age_ns,
            suspended_ns=self._suspended_ns,
            start_ns=self._start_ns,
        )
