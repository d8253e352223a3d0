"""The key of MAVLink 2 signatures: 32 bytes in a file of mode 0600. It is never logged and never on a command line."""

from __future__ import annotations

import hashlib
import re
import secrets
from pathlib import Path

from ..base import BadData, DeviceNotFound
from ..new_file import write_new

KEY_BYTES = 32
_HEX = re.compile(rb"^[0-9A-Fa-f]{64}$")
_REMEDY = "`companion keys --signing FILE` makes one"


class SigningKey:
    """A key that does not appear in messages or traces."""

    __slots__ = ("secret",)

    def __init__(self, secret: bytes) -> None:
        """Raises ValueError unless the key has 32 bytes that are not all 0: autopilots take zeros as a request not to
        sign."""
        if len(secret) != KEY_BYTES or not any(secret):
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not all of them 0; {_REMEDY}")
        self.secret = bytes(secret)

    def __repr__(self) -> str:
        return "SigningKey(...)"

    def signature(self, signed: bytes) -> bytes:
        """Returns the 6 bytes that end a frame, see `signature_of`."""
        return signature_of(self.secret, signed)


def signature_of(secret: bytes, signed: bytes) -> bytes:
    """Returns the 6 bytes that end a frame: the first 48 bits of SHA-256 of key and frame. signed: the frame up to
    them."""
    return hashlib.sha256(secret + signed).digest()[:6]


def load_key(path: Path) -> SigningKey:
    """Returns the key in a file of 64 hexadecimal digits or 32 bytes. Raises DeviceNotFound and BadData, also for a
    file that others can read. The content is never printed."""
    try:
        mode = path.stat().st_mode
        content = path.read_bytes()
    except OSError as error:
        raise DeviceNotFound(
            f"signing key {path}: {error.strerror}; {_REMEDY}, as the user who runs the service"
        ) from error
    if mode & 0o077:
        raise BadData(
            f"signing key {path}: others can read it (mode {mode & 0o777:o}); chmod 600 it, better make a new one"
        )
    if len(content) == KEY_BYTES:
        secret = content
    elif _HEX.match(content.strip()):
        secret = bytes.fromhex(content.strip().decode())
    else:
        raise BadData(f"signing key {path}: neither 64 hexadecimal digits nor {KEY_BYTES} bytes; {_REMEDY}")
    try:
        return SigningKey(secret)
    except ValueError as error:
        raise BadData(f"signing key {path}: {error}") from error


def make_key(path: Path, passphrase: str = "") -> None:
    """Writes a new key: a random one, or SHA-256 of a passphrase, as ground stations do. Raises ValueError if the
    file exists, OSError if it cannot be written."""
    secret = hashlib.sha256(passphrase.encode()).digest() if passphrase else secrets.token_bytes(KEY_BYTES)
    try:
        write_new(path, secret.hex().encode() + b"\n", 0o600)
    except FileExistsError as error:
        what = (
            "is a directory; give the name of a file" if path.is_dir() else "exists; delete it first, or name another"
        )
        raise ValueError(f"{path} {what}") from error
