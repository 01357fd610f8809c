"""Who asks: a client's name for people, and the key that tells it from others of the same name.

A client names itself in `X-Client` and, so that two of one name are two, gives an id of its own in
`X-Client-Id` (WebSockets of browsers: `?client=` and `&client_id=`). Without an id it is its name at its
address. This keeps people out of each other's way; it is no protection against somebody who is let in and
claims to be another: the token is what keeps strangers out.
"""

from __future__ import annotations

from hashlib import sha256

LONGEST_NAME = 64
LONGEST_ID = 64
KEY_LENGTH = 12


class Client(str):
    """A client's name, which knows whose it is. Equal names may be two clients: compare `key`."""

    __slots__ = ("address", "identified", "key")

    key: str
    """Made of the id or the address, never showing the id itself."""
    address: str
    """Where its request comes from; empty where only a name is known."""
    identified: bool
    """Whether it gave an id of its own: it means to be told from others."""

    @classmethod
    def of(cls, name: str, client_id: str = "", address: str = "") -> Client:
        """Made of what a request says of itself.

        Args:
            name: as in `X-Client`; the address where it is empty.
            client_id: as in `X-Client-Id`.
            address: where the request comes from.
        """
        shown = _printable(name)[:LONGEST_NAME] or address or "unknown"
        own = _printable(client_id)[:LONGEST_ID]
        client = cls(shown)
        secret = f"id {own}" if own else f"name {shown} at {address}"
        client.address = address
        client.identified = bool(own)
        client.key = sha256(secret.encode()).hexdigest()[:KEY_LENGTH]
        return client

    @classmethod
    def named(cls, name: str) -> Client:
        """The one that a name says, where only a name is known."""
        if isinstance(name, Client):
            return name
        client = cls.of(name)
        client.identified = True
        return client

    def __reduce__(self) -> tuple[object, ...]:
        return (str, (str(self),))  # a copy is a name: journal and samples keep no keys


def key_of(client: str) -> str:
    """What tells a client from others of its name, where it is passed on as a name."""
    return Client.named(client).key


def _printable(text: str) -> str:
    return "".join(c for c in text if c.isprintable()).strip()
