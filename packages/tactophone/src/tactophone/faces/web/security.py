"""Access control of the page: by token, Host and Origin.

The token is the first part of every path, so that the page's relative addresses contain
it and no cookie is needed. Two checks follow. *Host* must be a name of this machine, so
that a foreign name that resolves to it (DNS rebinding) is refused. *Origin* must be
this page, as browsers do not apply the same-origin rule to WebSockets.
"""

import ipaddress
import secrets
import socket
from dataclasses import dataclass, field
from urllib.parse import urlsplit

HEADERS = {
    # 'self' covers the page's own WebSocket too (CSP level 3).
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Sent with every response, refusals included."""


def headers_for(*, wasm: bool) -> dict[str, str]:
    """Return the headers of a page that compiles WebAssembly, or does not."""
    if not wasm:
        return HEADERS
    policy = HEADERS["Content-Security-Policy"].replace(
        "script-src 'self'", "script-src 'self' 'wasm-unsafe-eval'"
    )
    return {**HEADERS, "Content-Security-Policy": policy}


@dataclass(frozen=True, slots=True)
class AccessControl:
    """Decides whether a request is allowed.

    >>> access = AccessControl("127.0.0.1", 8470, token="secret")
    >>> access.url
    'http://127.0.0.1:8470/secret/'
    >>> access.refusal(token="secret", host="127.0.0.1:8470", origin=None)
    ''
    >>> access.refusal(token="secret", host="rebound.example:8470", origin=None)
    'Host is not an address of this page'
    """

    host: str
    port: int
    """`host` and `port`: where the server listens; ``0.0.0.0`` and ``::`` mean all
    interfaces."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)
    """Random, new for every page."""
    scheme: str = "http"
    """``http`` or ``https``."""
    names: tuple[str, ...] = ()
    """Further names of this machine under which it may be opened."""
    proof: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)
    """What the server says first on each WebSocket. A page gets it when it is loaded
    and never sends it, unlike the token: so a page that calls again after the run has
    ended obeys nobody who took over the port."""

    @property
    def url(self) -> str:
        """The address to open; with the machine's name if it listens on all
        interfaces."""
        host = socket.gethostname() if _everywhere(self.host) else self.host
        if ":" in host:  # an IPv6 address
            host = f"[{host}]"
        return f"{self.scheme}://{host}:{self.port}/{self.token}/"

    @property
    def private(self) -> bool:
        """Whether only this machine can reach the page."""
        return self.host == "localhost" or ipaddress.ip_address(self.host).is_loopback

    def refusal(
        self,
        *,
        token: str,
        host: str | None,
        origin: str | None,
        websocket: bool = False,
    ) -> str:
        """Return why a request is refused; empty if it is allowed."""
        if not secrets.compare_digest(token.encode(), self.token.encode()):
            return "the token is wrong"
        if host is None or not self._is_own_host(host):
            return "Host is not an address of this page"
        if origin is None and not websocket:
            return ""
        return "" if origin == f"{self.scheme}://{host}" else "Origin is another page"

    def _is_own_host(self, host: str) -> bool:
        try:
            parts = urlsplit(f"//{host}")
            name = parts.hostname or ""
            port = parts.port or (443 if self.scheme == "https" else 80)
        except ValueError:
            return False
        own = [
            "localhost",
            self.host,
            *self.names,
            *([socket.gethostname()] if _everywhere(self.host) else []),
        ]
        return port == self.port and (
            name in map(str.lower, own) or self._is_own_address(name)
        )

    def _is_own_address(self, name: str) -> bool:
        """Return whether the name is a numeric address of this machine; a rebound name
        never is."""
        address = _address(name)
        own = _address(self.host)
        if address is None:
            return False
        # The page is served at this machine's loopback address too, which no other
        # machine can be reached by.
        return (
            _everywhere(self.host)
            or address == own
            or (own is not None and address.is_loopback)
        )


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _everywhere(host: str) -> bool:
    address = _address(host)
    return address is not None and address.is_unspecified
