"""A headless Chromium, driven through its debugging pipe."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)


class Browser:
    """One page. Chromium reads commands from descriptor 3 and tells what happens on 4, each ended by a zero byte."""

    def __init__(self, profile: Path, *options: str) -> None:
        there, self._out = os.pipe()
        self._in, back = os.pipe()

        def descriptors() -> None:
            # away from 3 and 4 first, whatever the pipes' own numbers are
            reading, writing = os.dup(there), os.dup(back)
            os.dup2(reading, 3)
            os.dup2(writing, 4)

        self.process = subprocess.Popen(
            [str(BROWSER), *OPTIONS, *options, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=descriptors,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(there)
        os.close(back)
        self._rest = b""
        self._number = 0
        self.told: list[dict[str, Any]] = []
        target = self.send("Target.createTarget", url="about:blank", session=None)["targetId"]
        self.session = self.send("Target.attachToTarget", targetId=target, flatten=True, session=None)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, session: str | None = "own", **parameters: Any) -> dict[str, Any]:
        """A command's result. What the page tells meanwhile is kept in `told`."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = self.session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._receive()
            if reply.get("id") == self._number:
                assert "error" not in reply, reply
                return reply["result"]
            self.told.append(reply)

    def _receive(self, timeout_s: float = 30.0) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], timeout_s)
            assert ready, "the browser is silent"
            more = os.read(self._in, 1 << 20)
            assert more, "the browser has gone"
            self._rest += more
        line, _, self._rest = self._rest.partition(b"\0")
        return json.loads(line)

    def open(self, address: str) -> None:
        """Go there."""
        self.send("Page.navigate", url=address)

    def value(self, script: str) -> Any:
        """What an expression is in the page."""
        result = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def until(self, script: str, timeout_s: float = 15.0) -> Any:
        """What an expression is once it is true."""
        end = time.monotonic() + timeout_s
        while not (value := self.value(script)):
            assert time.monotonic() < end, f"never: {script}"
            time.sleep(0.03)
        return value

    def text(self, selector: str) -> str:
        """The text of an element as it can be seen."""
        return self.value(f"document.querySelector({json.dumps(selector)}).innerText")

    def size(self, width: int, height: int, dense: int = 1) -> None:
        """Of the window, on a screen of this many pixels per CSS pixel along a side."""
        look = {"width": width, "height": height, "deviceScaleFactor": dense, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", **look)

    def complaints(self) -> list[str]:
        """Errors that the page's scripts or its security policy raised."""
        self.value("0")
        wrong = []
        for event in self.told:
            if event.get("method") == "Runtime.exceptionThrown":
                wrong.append(str(event["params"]["exceptionDetails"]))
            entry = event.get("params", {}).get("entry", {})
            if event.get("method") == "Log.entryAdded" and entry.get("level") == "error":
                wrong.append(f"{entry.get('text')} {entry.get('url')}")
        return wrong

    def close(self) -> None:
        """End it."""
        os.close(self._out)
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self._in)
