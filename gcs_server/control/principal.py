"""The caller of a request: `api/principals.py` makes one principal per caller for routes and WebSockets.

A caller sends its name in `X-Client` and an id in `X-Client-Id`, which distinguishes callers of the same name
(WebSockets of browsers: `?client=` and `&client_id=`). Without an id, the caller is identified by name and
address. These identities coordinate operators; they do not protect against a caller that uses the identity of
another. The token protects access.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

from gcs_server.control.commands import PERMISSIONS, Permission

MAX_NAME_LENGTH = 64
MAX_ID_LENGTH = 64
KEY_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Principal:
    """A caller. Two callers may have the same name: compare `key`."""

    name: str
    """The caller's name, or else its address."""
    key: str
    """Hash of the id, or of name and address; does not reveal the id."""
    address: str = ""
    """Address of the request; empty if only a name is known."""
    identified: bool = False
    """Whether the caller sent an id."""
    permissions: frozenset[Permission] = PERMISSIONS
    """The caller's permissions; currently every caller has all permissions."""

    def __str__(self) -> str:
        return self.name

    @classmethod
    def from_identity(cls, name: str, client_id: str = "", address: str = "") -> Principal:
        """Creates a principal from a request's headers.

        Args:
            name: `X-Client`; if empty, the address is used.
            client_id: `X-Client-Id`.
            address: address of the request.
        """
        display_name = _printable(name)[:MAX_NAME_LENGTH] or address or "unknown"
        printable_id = _printable(client_id)[:MAX_ID_LENGTH]
        identity = f"id {printable_id}" if printable_id else f"name {display_name} at {address}"
        return cls(
            display_name, sha256(identity.encode()).hexdigest()[:KEY_LENGTH], address, bool(printable_id)
        )


def _printable(text: str) -> str:
    return "".join(c for c in text if c.isprintable()).strip()
