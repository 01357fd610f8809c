"""Stores signing keys by name, each in a file that only its owner can read, and the newest timestamp used."""

from __future__ import annotations

import base64
import binascii
import contextlib
import hashlib
import os
import re
import secrets
import stat
from collections.abc import Generator
from pathlib import Path
from typing import TextIO

from gcs_server.errors import GcsError, InvalidRequest
from gcs_server.links.names import checked_key_name
from gcs_server.mavlink.signing import KEY_BYTES, SecretKey
from gcs_server.storage.files import replace_file

SUFFIX = ".key"
MAX_FILE_LENGTH = 4096
MIN_PASSPHRASE_LENGTH = 12
"""Minimum number of characters, because an attacker with a recorded signed frame can try passphrases
offline."""
FORM_RULE = f"{KEY_BYTES} bytes as {2 * KEY_BYTES} hexadecimal digits or as base64"


class KeyUnusable(GcsError):
    """A signing key is missing, unreadable, or readable by others."""

    code = "signing_key"


class KeyStore:
    """The keys of one data folder.

    Args:
        folder: created with the first key; only its owner has access.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """Names of all keys."""
        with contextlib.suppress(OSError):
            return sorted(path.stem for path in self._folder.glob(f"*{SUFFIX}"))
        return []

    def read(self, name: str) -> SecretKey:
        """Reads the key of this name.

        Raises:
            InvalidRequest: the name is not valid.
            KeyUnusable: the file is missing, has no valid key, or is readable by others.
        """
        path = self._path(name)
        try:
            with path.open("rb") as file:
                mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
                text = file.read(MAX_FILE_LENGTH)
        except FileNotFoundError:
            known = ", ".join(self.names()) or "none"
            raise KeyUnusable(
                f"There is no signing key {name!r}; known: {known}.",
                remedy=f"Create it: gcs key new {name}, or add an existing one: gcs key add {name}.",
            ) from None
        except OSError as error:
            raise KeyUnusable(
                f"The signing key {name!r} cannot be read: {error.strerror or error}."
            ) from None
        if mode & 0o077:
            raise KeyUnusable(
                f"Others can read the signing key {name!r} ({path}, mode {mode:04o}).",
                remedy=f"chmod 600 {path}; if someone may have read it, create a new key.",
            )
        try:
            return parse_key(text.decode("ascii", errors="replace"))
        except ValueError:
            raise KeyUnusable(
                f"The signing key {name!r} ({path}) is damaged.", remedy=f"The file must contain {FORM_RULE}."
            ) from None

    def add(self, name: str, key: SecretKey) -> None:
        """Stores a key.

        Raises:
            InvalidRequest: the name is not valid, or in use.
            KeyUnusable: the file cannot be written.
        """
        path = self._path(name)
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with _new_file(path) as file:
                file.write(key.reveal().hex() + "\n")
        except FileExistsError:
            raise InvalidRequest(
                "name",
                f"A signing key {name!r} already exists.",
                remedy=f"Remove it: gcs key remove {name}.",
            ) from None
        except OSError as error:
            raise KeyUnusable(
                f"The signing key {name!r} cannot be written: {error.strerror or error}."
            ) from None

    def remove(self, name: str) -> None:
        """Deletes a key; open links keep using it until they are closed.

        Raises:
            KeyUnusable: the key does not exist, or cannot be deleted.
        """
        try:
            self._path(name).unlink()
        except OSError as error:
            raise KeyUnusable(
                f"The signing key {name!r} cannot be removed: {error.strerror or error}."
            ) from None

    def newest_timestamp(self) -> int:
        """The newest timestamp used for signing; 0 if unknown."""
        try:
            return max(0, int((self._folder / "timestamp").read_text()[:20]))
        except (OSError, ValueError):
            return 0

    def store_timestamp(self, timestamp: int) -> None:
        """Stores the newest timestamp. Raises OSError."""
        replace_file(self._folder / "timestamp", f"{timestamp}\n".encode(), sync=False)

    def _path(self, name: str) -> Path:
        return self._folder / f"{checked_key_name(name)}{SUFFIX}"


def parse_key(text: str) -> SecretKey:
    """Parses a key: 64 hexadecimal digits, or base64 of 32 bytes.

    Raises:
        ValueError: the text is not a key; the error does not repeat it.
    """
    text = text.strip()
    if re.fullmatch(rf"[0-9A-Fa-f]{{{2 * KEY_BYTES}}}", text):
        return SecretKey(bytes.fromhex(text))
    with contextlib.suppress(binascii.Error, ValueError):
        return SecretKey(base64.b64decode(text, validate=True))
    raise ValueError(f"a signing key has {FORM_RULE}")


def key_of_passphrase(text: str) -> SecretKey:
    """The key of a passphrase: SHA-256 of the text, as in MAVProxy.

    Raises:
        ValueError: the passphrase is too short.
    """
    if len(text) < MIN_PASSPHRASE_LENGTH:
        raise ValueError(f"a passphrase has at least {MIN_PASSPHRASE_LENGTH} characters")
    return SecretKey(hashlib.sha256(text.encode()).digest())


def random_key() -> SecretKey:
    """A random key."""
    return SecretKey(secrets.token_bytes(KEY_BYTES))


@contextlib.contextmanager
def _new_file(path: Path) -> Generator[TextIO]:
    """Opens a new file readable by its owner only; removes it if writing fails."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            os.fchmod(file.fileno(), 0o600)
            yield file
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        raise
