"""Who may talk to the page's server: this machine's browser, sent by the wizard's own address, with its token."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field
from email.message import Message


@dataclass(frozen=True)
class Gate:
    """The rules of one run.

    Attributes
    ----------
    port : the port that the server listens on.
    token : the run's secret.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

    @property
    def cookie(self) -> str:
        """The cookie's name; it holds the port, since a browser keeps one set of cookies for all ports."""
        return f"vbaa_wizard_{self.port}"

    @property
    def hosts(self) -> tuple[str, str]:
        """The two ways to write the own address."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    def fits(self, told: str) -> bool:
        """Whether this is the token, in a time that does not tell how much of it was right."""
        return hmac.compare_digest(told.encode("utf-8", "replace"), self.token.encode())

    def refusal(self, method: str, headers: Message, *, entering: bool = False) -> tuple[int, str] | None:
        """Why a request is refused, as a status and words; None: it may pass.

        `entering` : the request brings the token in its address, and is judged by that alone.
        """
        hosts = headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0].strip().lower() not in self.hosts:
            return 421, "this server answers only to its own address"
        if entering:
            return None
        if headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return 403, "another site may not use this page"
        bearer = self._bearer(headers)
        if not (bearer or self._known(headers)):
            return 403, "open the address that the wizard printed in the terminal: it carries this run's token"
        if method == "POST" and not self._own_origin(headers, required=not bearer):
            return 403, "another site may not send commands"
        return None

    def _own_origin(self, headers: Message, *, required: bool) -> bool:
        """Browsers tell the origin of every POST; a program with the token in its header need not."""
        origins = headers.get_all("Origin", [])
        if not origins:
            return not required
        return len(origins) == 1 and origins[0] in {f"http://{host}" for host in self.hosts}

    def _bearer(self, headers: Message) -> bool:
        word, _, told = headers.get("Authorization", "").partition(" ")
        return word == "Bearer" and self.fits(told)

    def _known(self, headers: Message) -> bool:
        pairs = (pair.strip().partition("=") for line in headers.get_all("Cookie", []) for pair in line.split(";"))
        return any(name == self.cookie and self.fits(value) for name, _, value in pairs)
