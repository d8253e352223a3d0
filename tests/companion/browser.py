"""A headless browser, controlled over a pipe (DevTools protocol): opens pages, evaluates expressions, takes pictures."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

FLAGS = (
    "--headless=new", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--disable-quic", "--disable-dev-shm-usage", "--hide-scrollbars",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--remote-debugging-pipe",
)  # fmt: skip
PATIENCE_S = 60.0
REFUSED = {("error", source) for source in ("security", "javascript", "rendering", "other")}
"""Of the browser's own words; that a server does not answer is none of the page's faults."""


def found_browser() -> str:
    """The browser of this machine; without one the test is skipped."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip("no browser here (chromium) to open the page with")


class Browser:
    """One process with a new empty profile. complaints: what pages wrote on their consoles as errors, or threw."""

    def __init__(self, profile: Path, size: str = "1200,800") -> None:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        command = ["bash", "-c", f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}', found_browser(), *FLAGS]
        with (profile.parent / "browser.txt").open("wb") as output:
            self.process = subprocess.Popen(
                [*command, f"--user-data-dir={profile}", f"--window-size={size}"],
                pass_fds=(theirs_in, theirs_out),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        os.close(theirs_in)
        os.close(theirs_out)
        self._in, self._out, self._rest, self._number = ours_in, ours_out, b"", 0
        self.complaints: list[str] = []
        self.forgiven: set[str] = set()

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._out)  # it ends when the pipe is closed
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self._in)

    def page(self, address: str, forgiven: bool = False) -> Page:
        """Opens an address in a page of its own. forgiven: its complaints do not count."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, target, session)
        if forgiven:
            page.forgive()
        for domain in ("Page", "Runtime", "Log"):
            page.call(f"{domain}.enable")
        page.call("Page.navigate", url=address)
        page.wait("document.readyState === 'complete' && location.href !== 'about:blank'")
        return page

    def call(self, method: str, session: str = "", **params: Any) -> dict[str, Any]:
        """A command and its result."""
        self._number += 1
        reply = {"id": self._number, "method": method, "params": params} | ({"sessionId": session} if session else {})
        os.write(self._out, json.dumps(reply).encode() + b"\0")
        end_s = time.monotonic() + PATIENCE_S
        while True:
            message = self._next(end_s, method)
            if message.get("id") == self._number:
                assert "error" not in message, f"{method}: {message['error']}"
                result: dict[str, Any] = message["result"]
                return result
            self._hear(message)

    def _next(self, end_s: float, what: str) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], max(0.0, end_s - time.monotonic()))
            assert ready, f"the browser does not answer: {what}"
            data = os.read(self._in, 1 << 20)
            assert data, f"the browser has ended: {what}"
            self._rest += data
        line, self._rest = self._rest.split(b"\0", 1)
        message: dict[str, Any] = json.loads(line)
        return message

    def _hear(self, message: dict[str, Any]) -> None:
        params = message.get("params", {})
        if message.get("sessionId") in self.forgiven:
            return
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(params["exceptionDetails"])[:500])
        elif message.get("method") == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
            self.complaints.append(json.dumps(params["args"])[:500])
        elif (
            message.get("method") == "Log.entryAdded"
            and (params["entry"]["level"], params["entry"]["source"]) in REFUSED
        ):
            self.complaints.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")


class Page:
    """One open page; it may be closed."""

    def __init__(self, browser: Browser, target: str, session: str) -> None:
        self._browser, self._target, self._session = browser, target, session

    def __enter__(self) -> Page:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._browser.call("Target.closeTarget", targetId=self._target)

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """A command to this page."""
        return self._browser.call(method, self._session, **params)

    def ask(self, expression: str) -> Any:
        """The value of a JavaScript expression, awaited."""
        reply = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in reply, f"{expression}: {reply['exceptionDetails']}"
        return reply["result"].get("value")

    def wait(self, expression: str, seconds: float = PATIENCE_S) -> float:
        """Waits until an expression is true; after how many seconds it was."""
        begun_s = time.monotonic()
        while not self.ask(expression):
            waited_s = time.monotonic() - begun_s
            assert waited_s < seconds, f"not true after {seconds} s: {expression}; the banner shows: {self.ask(BANNER)}"
            time.sleep(0.02)
        return time.monotonic() - begun_s

    def forgive(self) -> None:
        """What it complains of from now on does not count: it is or will be broken."""
        self._browser.forgiven.add(self._session)

    def key(self, name: str) -> None:
        """Presses a key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name)

    def picture(self, path: Path) -> None:
        """As it looks now."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))


BANNER = "document.getElementById('banner')?.textContent"


@contextmanager
def opened(folder: Path, size: str = "1200,800") -> Iterator[Browser]:
    """A browser whose pages have nothing to complain of at the end."""
    with Browser(folder / "profile", size) as browser:
        yield browser
        browser.call("Browser.getVersion")  # messages until now are received
        assert not browser.complaints
