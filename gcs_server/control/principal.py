"""Who asks: one principal per caller, made by `api/principals.py` and handed to routes and WebSockets.

A caller names itself in `X-Client` and, so that two of one name are two, gives an id of its own in
`X-Client-Id` (WebSockets of browsers: `?client=` and `&client_id=`). Without an id it is its name at its
address. This keeps people out of each other's way; it is no protection against somebody who is let in and
claims to be another: the token is what keeps strangers out.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

from gcs_server.control.commands import PERMISSIONS, Permission

LONGEST_NAME = 64
LONGEST_ID = 64
KEY_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Principal:
    """A caller. Equal names may be two callers: compare `key`."""

    name: str
    """For people: what it calls itself, else its address."""
    key: str
    """Made of the id or the address, never showing the id itself."""
    address: str = ""
    """Where its request comes from; empty where only a name is known."""
    identified: bool = False
    """Whether it gave an id of its own: it means to be told from others."""
    permissions: frozenset[Permission] = PERMISSIONS
    """What it may do; today everybody who is let in may do everything."""

    def __str__(self) -> str:
        return self.name

    @classmethod
    def of(cls, name: str, own_id: str = "", address: str = "") -> Principal:
        """Made of what a request says of itself.

        Args:
            name: as in `X-Client`; the address where it is empty.
            own_id: as in `X-Client-Id`.
            address: where the request comes from.
        """
        shown = _printable(name)[:LONGEST_NAME] or address or "unknown"
        own = _printable(own_id)[:LONGEST_ID]
        secret = f"id {own}" if own else f"name {shown} at {address}"
        return cls(shown, sha256(secret.encode()).hexdigest()[:KEY_LENGTH], address, bool(own))


def _printable(text: str) -> str:
    return "".join(c for c in text if c.isprintable()).strip()
