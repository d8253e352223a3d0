"""What the web servers of this package share: no name resolution, no line per request, no traceback of a lost connection."""

from __future__ import annotations

import sys
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer
from typing import Any


class HttpServer(TCPServer):
    """A TCPServer in place of http.server.HTTPServer, which resolves the host name before it listens."""

    allow_reuse_address = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores connections that the client has reset; prints the traceback of other exceptions."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class HttpHandler(BaseHTTPRequestHandler):
    """Does not name the version of Python."""

    server_version = "osape-companion"
    sys_version = ""

    def log_message(self, format: str, *args: object) -> None:
        """Writes nothing: each request would add a line."""
