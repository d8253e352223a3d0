"""Client library for the obstacle streams of osape-companion. Needs pyzmq, protobuf and numpy only."""

from .curve_keys import KeyFileError
from .model import CameraModel, FreeEnd, FreeProfile, Ground, PlaneFlags, Prism
from .neighbours import Neighbour, NeighbourMover, NeighbourObstacles
from .neighbours_subscriber import NeighboursSubscriber
from .query.space import Occupancy, PlacedModel, Space
from .subscriber import Message, ReceiveStats, Subscriber, UnavailableCamera
from .tracks import MovingObstacle, Tracks, TrackState, tracks_from_message
from .tracks_subscriber import ReceivedTracks, TracksSubscriber
from .world.level_memory import LevelMemory
from .world.mirror import MirrorStats, WorldMirror
from .world.snapshot import WorldSnapshot
from .world.space import WorldSpace

__all__ = [
    "CameraModel",
    "FreeEnd",
    "FreeProfile",
    "Ground",
    "KeyFileError",
    "LevelMemory",
    "Message",
    "MirrorStats",
    "MovingObstacle",
    "Neighbour",
    "NeighbourMover",
    "NeighbourObstacles",
    "NeighboursSubscriber",
    "Occupancy",
    "PlacedModel",
    "PlaneFlags",
    "Prism",
    "ReceiveStats",
    "ReceivedTracks",
    "Space",
    "Subscriber",
    "TrackState",
    "Tracks",
    "TracksSubscriber",
    "UnavailableCamera",
    "WorldMirror",
    "WorldSnapshot",
    "WorldSpace",
    "tracks_from_message",
]
