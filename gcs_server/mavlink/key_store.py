"""Signing keys by name, each a file that only its owner can read, and the newest timestamp that was used."""

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

SUFFIX = ".key"
LONGEST_FILE = 4096
LEAST_PASSPHRASE = 12
"""Characters. Whoever records a signed frame can try passphrases on it for as long as he likes."""
FORM_IN_WORDS = f"{KEY_BYTES} bytes as {2 * KEY_BYTES} hexadecimal digits or as base64"


class KeyUnusable(GcsError):
    """A signing key is missing, cannot be read, or others can read it."""

    code = "signing_key"


class KeyStore:
    """The keys of one data folder.

    Args:
        folder: made, for its owner only, with the first key.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """The names of all keys; never the keys themselves."""
        with contextlib.suppress(OSError):
            return sorted(path.stem for path in self._folder.glob(f"*{SUFFIX}"))
        return []

    def read(self, name: str) -> SecretKey:
        """The key of that name.

        Raises:
            InvalidRequest: no key can be called so.
            KeyUnusable: it is not there, holds no key, or others may read it.
        """
        path = self._path(name)
        try:
            with path.open("rb") as file:
                mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
                text = file.read(LONGEST_FILE)
        except FileNotFoundError:
            known = ", ".join(self.names()) or "none"
            raise KeyUnusable(
                f"There is no signing key {name!r}; known: {known}.",
                remedy=f"Make it: gcs key new {name}, or give it one: gcs key add {name}.",
            ) from None
        except OSError as error:
            raise KeyUnusable(
                f"The signing key {name!r} cannot be read: {error.strerror or error}."
            ) from None
        if mode & 0o077:
            raise KeyUnusable(
                f"Others can read the signing key {name!r} ({path}, mode {mode:04o}).",
                remedy=f"chmod 600 {path}; if somebody may have read it, make a new one.",
            )
        try:
            return parse_key(text.decode("ascii", errors="replace"))
        except ValueError:
            raise KeyUnusable(
                f"The signing key {name!r} ({path}) is damaged.", remedy=f"It holds {FORM_IN_WORDS}."
            ) from None

    def add(self, name: str, key: SecretKey) -> None:
        """Keeps a key.

        Raises:
            InvalidRequest: the name cannot be one, or is taken.
            KeyUnusable: it cannot be written.
        """
        path = self._path(name)
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with _new_file(path) as file:
                file.write(key.reveal().hex() + "\n")
        except FileExistsError:
            raise InvalidRequest(
                "name",
                f"There is a signing key {name!r} already.",
                remedy=f"Remove it: gcs key remove {name}.",
            ) from None
        except OSError as error:
            raise KeyUnusable(
                f"The signing key {name!r} cannot be written: {error.strerror or error}."
            ) from None

    def remove(self, name: str) -> None:
        """Forgets a key; open links go on with it until they are closed.

        Raises:
            KeyUnusable: it is not there, or cannot be deleted.
        """
        try:
            self._path(name).unlink()
        except OSError as error:
            raise KeyUnusable(
                f"The signing key {name!r} cannot be removed: {error.strerror or error}."
            ) from None

    def newest_timestamp(self) -> int:
        """The newest that was used to sign; 0 where none is known."""
        try:
            return max(0, int((self._folder / "timestamp").read_text()[:20]))
        except (OSError, ValueError):
            return 0

    def keep_timestamp(self, timestamp: int) -> None:
        """Remembers it. Raises OSError."""
        path = self._folder / "timestamp"
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        draft.write_text(f"{timestamp}\n")
        draft.replace(path)

    def _path(self, name: str) -> Path:
        return self._folder / f"{checked_key_name(name)}{SUFFIX}"


def parse_key(text: str) -> SecretKey:
    """A key as people give it: 64 hexadecimal digits, or base64 of 32 bytes.

    Raises:
        ValueError: it is none; the text is not repeated.
    """
    text = text.strip()
    if re.fullmatch(rf"[0-9A-Fa-f]{{{2 * KEY_BYTES}}}", text):
        return SecretKey(bytes.fromhex(text))
    with contextlib.suppress(binascii.Error, ValueError):
        return SecretKey(base64.b64decode(text, validate=True))
    raise ValueError(f"a signing key has {FORM_IN_WORDS}")


def key_of_passphrase(text: str) -> SecretKey:
    """SHA-256 of the text, as MAVProxy makes a key of its passphrase.

    Raises:
        ValueError: too short.
    """
    if len(text) < LEAST_PASSPHRASE:
        raise ValueError(f"a passphrase has at least {LEAST_PASSPHRASE} characters")
    return SecretKey(hashlib.sha256(text.encode()).digest())


def random_key() -> SecretKey:
    """One that nobody can guess."""
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
