"""CURVE keys of a client, for a service on another machine.

The folder holds `server.public` and one `NAME.secret`, both written by `companion keys` on the service's machine.
"""

from __future__ import annotations

import re
from pathlib import Path

import zmq

SERVER_SECRET, SERVER_PUBLIC = "server.secret", "server.public"
_KEY = re.compile(rb"^[\x21-\x7e]{40}$")


class KeyFileError(ValueError):
    """A key file is missing or damaged. The message names the file and the remedy."""


def use_client_keys(socket: zmq.Socket[bytes], folder: Path) -> None:
    """Configures a socket to authenticate the service and itself with the keys in a folder. Raises KeyFileError."""
    try:
        secrets = [f for f in sorted(folder.iterdir()) if f.suffix == ".secret" and f.name != SERVER_SECRET]
    except OSError as error:
        raise KeyFileError(
            f"{folder}: {error.strerror}; give the folder of the client's keys, readable by you"
        ) from error
    if len(secrets) != 1:
        raise KeyFileError(
            f"{folder}: {len(secrets)} client secrets, expected one NAME.secret beside {SERVER_PUBLIC}, both as "
            "`companion keys` wrote them"
        )
    try:
        secret, server = read_key(secrets[0]), read_key(folder / SERVER_PUBLIC)
    except OSError as error:
        raise KeyFileError(
            f"{error.filename}: {error.strerror}; copy it from the folder in which `companion keys` ran"
        ) from error
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
    socket.setsockopt(zmq.CURVE_PUBLICKEY, zmq.curve_public(secret))
    socket.setsockopt(zmq.CURVE_SERVERKEY, server)


def read_key(path: Path) -> bytes:
    """The key in a file, 40 characters of Z85. Raises KeyFileError where it is damaged, OSError where it cannot be read."""
    key = path.read_bytes().strip()
    if not _KEY.match(key):
        raise KeyFileError(f"{path}: not a key of 40 characters; make new ones with `companion keys`")
    return key
