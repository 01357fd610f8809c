"""The token that lets in people from other machines, made once and kept: a restart logs nobody out."""

from __future__ import annotations

import os
import re
import secrets
from pathlib import Path

from gcs_server.storage.folder import StorageError

FORM = re.compile(r"[A-Za-z0-9._~-]{16,256}")
"""Characters that fit into a URL and a header unescaped; shorter tokens could be guessed."""
FORM_IN_WORDS = "16 to 256 letters, digits or . _ ~ -"
_LONGEST_FILE = 4096


def is_well_formed(token: str) -> bool:
    """Whether it can serve as a token."""
    return FORM.fullmatch(token) is not None


def kept_token(file: Path) -> str:
    """The token in `file`; a random one is written there, readable by its owner only, where there is none.

    Raises:
        StorageError: it cannot be read or made, or what it holds is no token; says which and what to do.
    """
    try:
        with file.open(encoding="utf-8") as stream:
            token = stream.read(_LONGEST_FILE).strip()
    except FileNotFoundError:
        return _make(file)
    except (OSError, UnicodeDecodeError) as error:
        raise _unusable(file, f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not is_well_formed(token):
        raise _unusable(file, f"holds no token ({FORM_IN_WORDS})")
    return token


def _make(file: Path) -> str:
    token = secrets.token_urlsafe(32)
    try:
        # Never there with other rights or half written: made aside, then put in its place.
        draft = file.with_name(f".{file.name}.{os.getpid()}")
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(token + "\n")
        draft.replace(file)
    except OSError as error:
        raise _unusable(file, f"cannot be made: {error.strerror or error}") from error
    return token


def _unusable(file: Path, what: str) -> StorageError:
    return StorageError(
        f"The token's file {file} {what}.",
        remedy="Delete it to have a new one made, name another with --token-file, or set GCS_TOKEN.",
    )
