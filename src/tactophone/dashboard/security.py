"""Who may see the page: holders of the token, who came to this machine by its own name.

The token is the first part of every path, so that a page's own relative addresses carry it and no cookie is needed.
Two more doors stand behind it. *Host*: a foreign name that was made to point here (DNS rebinding) is not one of ours.
*Origin*: another site's page that guesses our address cannot open a WebSocket, which browsers do not hold to the
same-origin rule.
"""

import ipaddress
import secrets
import socket
from dataclasses import dataclass, field
from urllib.parse import urlsplit

HEADERS = {
    # 'self' covers the page's own WebSocket too (CSP level 3).
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Sent with every answer, refusals included."""


@dataclass(frozen=True, slots=True)
class AccessControl:
    """Decides for each request whether it may pass.

    Parameters
    ----------
    host, port
        Where the server listens; ``0.0.0.0`` and ``::`` mean everywhere.
    token
        Drawn anew for every run.

    Examples
    --------
    >>> guard = AccessControl("127.0.0.1", 8470, token="secret")
    >>> guard.url
    'http://127.0.0.1:8470/secret/'
    >>> guard.refusal(token="secret", host="127.0.0.1:8470", origin=None)
    ''
    >>> guard.refusal(token="secret", host="rebound.example:8470", origin=None)
    'Host is not an address of this page'
    """

    host: str
    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)

    @property
    def url(self) -> str:
        """What a person opens; from other machines where it listens everywhere."""
        host = socket.gethostname() if _everywhere(self.host) else self.host
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/{self.token}/"

    @property
    def private(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host == "localhost" or ipaddress.ip_address(self.host).is_loopback

    def refusal(self, *, token: str, host: str | None, origin: str | None, websocket: bool = False) -> str:
        """Say why a request is refused; nothing when it may pass."""
        if not secrets.compare_digest(token.encode(), self.token.encode()):
            return "the token is wrong"
        if host is None or not self._is_ours(host):
            return "Host is not an address of this page"
        if origin is None and not websocket:
            return ""
        return "" if origin == f"http://{host}" else "Origin is another page"

    def _is_ours(self, host: str) -> bool:
        try:
            asked = urlsplit(f"//{host}")
            name, port = asked.hostname or "", asked.port or 80
        except ValueError:
            return False
        return port == self.port and (name in self._names or self._is_our_address(name))

    @property
    def _names(self) -> set[str]:
        return {"localhost", self.host} | ({socket.gethostname().lower()} if _everywhere(self.host) else set())

    def _is_our_address(self, name: str) -> bool:
        """Tell whether it is an address in figures that leads here: a rebound name never is."""
        asked, own = _address(name), _address(self.host)
        if asked is None:
            return False
        return _everywhere(self.host) or asked == own or (asked.is_loopback and own is not None and own.is_loopback)


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _everywhere(host: str) -> bool:
    address = _address(host)
    return address is not None and address.is_unspecified
