"""A node of a ROS 2 graph on Zenoh (extra `ros2`): publishers that rmw_zenoh's subscriptions receive."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import dataclass, replace
from typing import Any, Final

from drivers.optional_library import optional_module

from .message_types import NEED, RosMessages
from .wire import NodeName, gid, topic_key

CONNECT_TIMEOUT_MS: Final = 1000


@dataclass(slots=True)
class _Publisher:
    """A publisher of the session."""

    publisher: Any
    token: Any
    gid: bytes
    number: int = 0  # of messages published


class RosNode:
    """A node with publishers that are declared at their first message. `connect` and `publish` may be called from different
    threads. Raises DeviceNotFound where the extra is not installed."""

    def __init__(self, messages: RosMessages, router: str, domain: int, namespace: str, name: str) -> None:
        self._zenoh, self._ext = optional_module("zenoh", *NEED), optional_module("zenoh.ext", *NEED)
        self._messages, self._router = messages, router
        self._lock = threading.Lock()
        self._session: Any = None
        self._node = NodeName(domain, "", namespace, name)
        self._node_token: Any = None
        self._publishers: dict[str, _Publisher] = {}

    def connect(self) -> str:
        """Connects to the router where there is no session yet. Returns why there is no connection; "": there is one.

        A session that has lost its router connects again by itself, with its publishers."""
        if self._session is None:
            try:
                session = self._zenoh.open(self._config())
            except self._zenoh.ZError as error:
                text = str(error).split(" at /")[0]  # without the place in the library's sources
                return self._unreachable("no answer" if "Timeout" in text else text)
            with self._lock:
                self._session, self._node = session, replace(self._node, zid=str(session.zid()))
                self._node_token = session.liveliness().declare_token(self._node.token())
        return "" if self._session.info.routers_zid() else self._unreachable("the connection was lost")

    def publish(self, topic: str, name: str, message: Any) -> bool:
        """Publishes a message of a type such as tf2_msgs/msg/TFMessage. False: there is no session yet."""
        data = self._messages.serialise(message, name)
        with self._lock:
            if self._session is None:
                return False
            publisher = self._publishers.get(topic) or self._declare(topic, name)
            publisher.number += 1
            publisher.publisher.put(data, attachment=self._attachment(publisher))
        return True

    def close(self) -> None:
        """Leaves the graph. May be called twice."""
        with self._lock:
            session, self._session = self._session, None
            self._publishers.clear()
        if session is not None:
            session.close()

    def _config(self) -> Any:
        config = self._zenoh.Config()
        settings: dict[str, Any] = {
            "mode": "client",
            "connect/endpoints": [self._router],
            "connect/timeout_ms": CONNECT_TIMEOUT_MS,
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,  # as the nodes of rmw_zenoh
        }
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return config

    def _declare(self, topic: str, name: str) -> _Publisher:
        """Declares a publisher, with the lock held."""
        kind = self._messages.topic_type(name)
        token = self._node.publisher_token(len(self._publishers) + 1, topic, kind)
        publisher = self._session.declare_publisher(
            topic_key(self._node.domain, topic, kind), congestion_control=self._zenoh.CongestionControl.DROP
        )
        declared = _Publisher(publisher, self._session.liveliness().declare_token(token), gid(token))
        self._publishers[topic] = declared
        return declared

    def _attachment(self, publisher: _Publisher) -> Any:
        """Sequence number from 1, wall time of sending in ns, identifier of the publisher."""
        Int64 = self._ext.Int64
        return self._ext.z_serialize((Int64(publisher.number), Int64(time.time_ns()), publisher.gid))

    def _unreachable(self, cause: str) -> str:
        return (
            f"no Zenoh router at {self._router} ({cause}): start one with `ros2 run rmw_zenoh_cpp rmw_zenohd`, or name its "
            "address with --router"
        )
