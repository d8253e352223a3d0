"""Keys for streams to other computers: CURVE, with a list of the clients that may subscribe.

A folder of keys contains server.secret (mode 0600), server.public (given to clients), and clients/NAME.public, one for
each client that may subscribe. `companion keys` makes them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import zmq

from drivers.base import BadData, DeviceNotFound
from drivers.new_file import write_new
from osape_client.curve_keys import SERVER_PUBLIC, SERVER_SECRET, KeyFileError, read_key

CLIENTS = "clients"


@dataclass(frozen=True, slots=True, repr=False)
class ServerKeys:
    """The keys of the service, and the public keys of the clients that may subscribe. Without a repr, so that the secret is in
    no message or traceback."""

    secret: bytes
    public: bytes
    clients: tuple[bytes, ...]


def check_client(name: str) -> None:
    """Raises ValueError for a name that cannot be one of a client: it is part of file names, beside those of the server."""
    if not re.fullmatch(r"[A-Za-z0-9._-]+", name):
        raise ValueError(f"client name {name!r}: expected letters, digits, dot, dash and underscore")
    if f"{name}.secret" == SERVER_SECRET:
        raise ValueError(f"client name {name!r}: {SERVER_SECRET} is the file of the service; use another name")


def make_keys(folder: Path, client: str) -> list[Path]:
    """Makes the server's keys, where there are none, and those of a client; returns the files written, the client's
    secret last: it goes to the client and nowhere else. Raises ValueError for a client there is already, OSError where a file
    cannot be written: none is left then."""
    check_client(client)
    clients = folder / CLIENTS
    clients.mkdir(parents=True, exist_ok=True, mode=0o700)
    if (clients / f"{client}.public").exists():
        raise ValueError(
            f"{clients / f'{client}.public'}: there is such a client; delete its keys first, or choose another name"
        )
    files: list[tuple[Path, bytes, int]] = []
    if not (folder / SERVER_SECRET).exists():
        public, secret = zmq.curve_keypair()
        files += [(folder / SERVER_SECRET, secret, 0o600), (folder / SERVER_PUBLIC, public, 0o644)]
    public, secret = zmq.curve_keypair()
    files += [(clients / f"{client}.public", public, 0o644), (folder / f"{client}.secret", secret, 0o600)]
    written: list[Path] = []
    try:
        for path, key, mode in files:
            write_new(path, key + b"\n", mode)
            written.append(path)
    except OSError:
        for path in written:
            path.unlink(missing_ok=True)
        raise
    return written


def load_keys(folder: Path) -> ServerKeys:
    """The keys of a folder. Raises DeviceNotFound and BadData, also for a secret that others can read."""
    secret_file = folder / SERVER_SECRET
    try:
        mode = secret_file.stat().st_mode
        if mode & 0o077:
            raise BadData(
                f"{secret_file}: others can read it (mode {mode & 0o777:o}); chmod 600 it, better make new keys"
            )
        secret, public = read_key(secret_file), read_key(folder / SERVER_PUBLIC)
        clients = tuple(read_key(f) for f in sorted((folder / CLIENTS).glob("*.public")))
    except OSError as error:
        raise DeviceNotFound(f"{error.filename}: {error.strerror}; `companion keys` makes keys") from error
    except KeyFileError as error:
        raise BadData(str(error)) from error
    if not clients:
        raise BadData(f"{folder / CLIENTS}: no client may subscribe; add one with `companion keys --client NAME`")
    return ServerKeys(secret, public, clients)


def serve(socket: zmq.Socket[bytes], keys: ServerKeys) -> None:
    """Restricts a socket to the known clients. Its context needs an AllowList."""
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, keys.secret)
    socket.setsockopt(zmq.ZAP_DOMAIN, b"osape")


class AllowList:
    """Checks the keys of clients that connect to the sockets of a context. Keep it until these are closed."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys) -> None:
        from zmq.auth.thread import ThreadAuthenticator  # imports asyncio and ssl: only where there are keys

        self._auth = ThreadAuthenticator(context)
        self._auth.start()
        self._auth.configure_curve_callback("osape", _Known(keys.clients))

    @property
    def running(self) -> bool:
        """Whether its thread runs."""
        return bool(self._auth.is_alive())

    def close(self) -> None:
        """Ends the thread. May be called twice."""
        self._auth.stop()


class _Known:
    """The callback that the library expects: an object with this method."""

    def __init__(self, clients: tuple[bytes, ...]) -> None:
        self._clients = frozenset(clients)

    def callback(self, domain: str, key: bytes) -> bool:
        """key: z85 of the client's public key."""
        return key in self._clients
