"""Who may use the browser page, and what they may send it.

viser serves every visitor, and lets a message set any attribute of a widget. A web page that somebody has open in
another tab could so reach a page on this machine. Here every request must name this machine (so that no other name
resolves to it), come from the page itself, and carry the token of its address; and every message must be one that the
page's own script sends, with numbers that are finite.
"""

from __future__ import annotations

import hmac
import http
import ipaddress
import math
import secrets
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

__all__ = ["Guard", "acceptable"]

_MOST_BYTES = 100_000
"""Of one message from a visitor."""


class Guard:
    """Looks at every request and message of a page.

    host : address that is served
    token : the address's secret part; by default a new one
    """

    def __init__(self, host: str, token: str | None = None) -> None:
        self.host, self.token = host, secrets.token_urlsafe(16) if token is None else token
        self.kinds: dict[str, type] = {}
        """By the id of every widget that visitors may change, the kind of its value: `bool`, `str`, or a number."""
        self.refused = 0
        """Requests and messages that were not let through."""
        self._served = False
        if not self._is_here(host):
            print(
                f"warning: everybody who reaches {host} over the network can see the page's requests, its token "
                "included, and use it: nothing is encrypted. An ssh tunnel to the default address is safer.",
                file=sys.stderr, flush=True,
            )  # fmt: skip

    def address(self, port: int) -> str:
        """The page's address, with the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/{self.token}/"

    def why_not(self, path: str, host: str | None, origin: str | None) -> str:
        """Why a request is refused; empty if it is not.

        path : of the request
        host, origin : the headers
        """
        name = _name(f"//{host}") if host else None
        if name is None or not self._is_served_under(name):
            return f"this page is not at {host!r}"
        if origin is not None and origin.partition("://")[2].lower() != (host or "").lower():
            return f"a page of {origin!r} may not use this one"
        part = path.lstrip("/").partition("?")[0].partition("/")[0]
        if not hmac.compare_digest(part.encode("utf-8", "replace"), self.token.encode()):
            return "open the whole address that magwire view printed: it ends in a token"
        return ""

    @contextmanager
    def over_servers(self) -> Iterator[None]:
        """What viser serves that is begun within stands under this guard.

        Raises `RuntimeError` if nothing was: a viser that serves in another way is not let through unguarded.
        """
        import websockets.asyncio.server as served

        real: Any = served.serve

        def serve(handler: Any, *args: Any, process_request: Any = None, **options: Any) -> Any:
            self._served = True
            options["max_size"] = _MOST_BYTES
            return real(self._filtered(handler), *args, process_request=self._checked(process_request), **options)

        served.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            served.serve = real  # type: ignore[misc]
        if not self._served:
            raise RuntimeError(
                "this version of viser serves its page in a way that cannot be guarded: install viser 1.1"
            )

    def _checked(self, inner: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
        """viser's own answer to a request, for those that are let through."""

        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
            why = "a request has one Host and one Origin" if len(hosts) != 1 or len(origins) > 1 else ""
            why = why or self.why_not(request.path, hosts[0], origins[0] if origins else None)
            if why:
                self.refused += 1
                return connection.respond(http.HTTPStatus.FORBIDDEN, why + "\n")
            request.path = "/" + request.path.lstrip("/").partition("/")[2]
            answer = None if inner is None else inner(connection, request)
            if answer is not None:
                # Neither another page nor a link on this one learns the token; no other page shows this one in a frame.
                answer.headers["Referrer-Policy"] = "no-referrer"
                answer.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
                answer.headers["X-Content-Type-Options"] = "nosniff"
            return answer

        return process

    def _filtered(self, handler: Any) -> Any:
        async def handle(connection: Any) -> None:
            await handler(_Filtered(connection, self))

        return handle

    @staticmethod
    def _is_here(name: str) -> bool:
        """A name of this machine that no other can reach."""
        try:
            return ipaddress.ip_address(name).is_loopback
        except ValueError:
            return name.lower() == "localhost"

    def _is_served_under(self, name: str) -> bool:
        """An attacker's own name may resolve to this machine, but not a number, nor a name that is this machine's."""
        if self._is_here(self.host):
            return self._is_here(name)
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name.lower() in {
                "localhost",
                self.host.lower(),
                socket.gethostname().lower(),
                socket.getfqdn().lower(),
            }
        return True


class _Filtered:
    """A visitor's connection, of which only acceptable messages are received."""

    def __init__(self, connection: Any, guard: Guard) -> None:
        self._connection, self._guard = connection, guard

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    async def recv(self, *args: Any, **options: Any) -> bytes:
        """The next acceptable message; the others are passed over."""
        while True:
            message = await self._connection.recv(*args, **options)
            if isinstance(message, bytes) and acceptable(message, self._guard.kinds):
                return message
            self._guard.refused += 1


def _name(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None


# --- messages ---------------------------------------------------------------------------------------------------------


def acceptable(message: bytes, kinds: Mapping[str, type]) -> bool:
    """Whether a message is one that the page's own script sends, with the fields and kinds it sends.

    kinds : of the values of the widgets that may be changed, by their ids
    """
    import msgspec

    try:
        content = msgspec.msgpack.decode(message)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return False
    name = content.get("type") if isinstance(content, dict) else None
    fields = _MESSAGES.get(name) if isinstance(name, str) else None
    if fields is None or not set(content) - {"type"} <= set(fields):
        return False
    if not all(check(content.get(field, _ABSENT)) for field, check in fields.items()):
        return False
    return name != "GuiUpdateMessage" or _of_kind(content["updates"]["value"], kinds.get(content["uuid"]))


def _of_kind(value: Any, kind: type | None) -> bool:
    if kind is None or isinstance(value, bool) or kind is bool:
        return kind is bool and isinstance(value, bool)
    return isinstance(value, str) if kind is str else _number(value)


_ABSENT = object()


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and abs(value) < 1e9


def _numbers(count: int) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and len(value) == count and all(map(_number, value))


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= 500


def _text_or_none(value: Any) -> bool:
    return value is None or value is _ABSENT or _text(value)


def _index_or_none(value: Any) -> bool:
    return value is None or value is _ABSENT or (isinstance(value, int) and 0 <= value < 2**31)


def _new_value(value: Any) -> bool:
    """A widget's new value, and nothing else of it."""
    return isinstance(value, dict) and list(value) == ["value"]


_MESSAGES: dict[str, dict[str, Callable[[Any], bool]]] = {
    "ViewerCameraMessage": {
        "wxyz": _numbers(4), "position": _numbers(3), "fov": _number, "near": _number, "far": _number,
        "image_height": _number, "image_width": _number, "look_at": _numbers(3), "up_direction": _numbers(3),
    },
    "GuiUpdateMessage": {"uuid": _text, "updates": _new_value},
    "TransformControlsUpdateMessage": {
        "name": _text, "wxyz": _numbers(4), "position": _numbers(3), "owner": _text_or_none,
    },
    "TransformControlsDragStartMessage": {"name": _text, "owner": _text_or_none},
    "TransformControlsDragEndMessage": {"name": _text, "owner": _text_or_none},
    "SceneNodeClickMessage": {
        "name": _text, "instance_index": _index_or_none, "ray_origin": _numbers(3), "ray_direction": _numbers(3),
        "screen_pos": _numbers(2), "modifier": _text_or_none, "owner": _text_or_none,
    },
}  # fmt: skip
"""What the page's script sends, and each field's check. Left out: what would open a tunnel, upload a file, or end a
dialogue that this page does not have."""
