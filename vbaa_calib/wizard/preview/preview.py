"""The wizard's window: a page on 127.0.0.1, since OpenCV's headless build has none."""

from __future__ import annotations

import threading
from types import TracebackType

from vbaa_calib.core.errors import InputError

from .hub import Hub
from .server import Gate, Router, Server
from .snapshot import Command, Snapshot


class Preview:
    """A live page of the wizard for the browsers of this machine that were given its address.

    `show` and `take_commands` may be called from any thread and never wait for a browser. The server listens from the
    start, so that `url` is known, and answers from `start()` to `close()`.

    Parameters
    ----------
    port : to listen on, at 127.0.0.1; 0: any that is free.

    Raises
    ------
    InputError : the port cannot be had.
    """

    def __init__(self, port: int = 0) -> None:
        try:
            self._server = Server(port)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(
                f"the page cannot listen on port {port}: {reason}", remedy="give another port, or 0 for any"
            ) from error
        self._hub = Hub()
        self._gate = Gate(self._server.server_port)
        self._server.router = Router(self._gate, self._hub)
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, name="preview", daemon=True
        )

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._gate.port

    @property
    def url(self) -> str:
        """The address to open, with this run's token: whoever has it can see the page and give commands."""
        return f"http://127.0.0.1:{self._gate.port}/?token={self._gate.token}"

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def show(self, snapshot: Snapshot) -> int:
        """Make this what the page shows; its number, which commands given on seeing it carry.

        Raises
        ------
        TypeError : something in the state has no JSON form.
        """
        return self._hub.publish(snapshot)

    def take_commands(self) -> list[Command]:
        """What was commanded since the last call, in order."""
        return self._hub.take()

    def close(self) -> None:
        """Stop answering; may be called twice. What is still being sent to a browser is not waited for."""
        self._hub.close()
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.server_close()

    def __enter__(self) -> Preview:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
