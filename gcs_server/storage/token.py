"""The access token for other machines. The token is stored, so that sign-ins survive a restart."""

from __future__ import annotations

import re
import secrets
from pathlib import Path

from gcs_server.storage.files import replace_file
from gcs_server.storage.folder import StorageError

TOKEN_PATTERN = re.compile(r"[A-Za-z0-9._~-]{16,256}")
"""Characters that need no escaping in URLs and headers; the length prevents guessing."""
TOKEN_RULE = "16 to 256 letters, digits or . _ ~ -"
_MAX_FILE_LENGTH = 4096


def is_well_formed(token: str) -> bool:
    """Whether the text is a valid token."""
    return TOKEN_PATTERN.fullmatch(token) is not None


def load_or_create_token(file: Path) -> str:
    """The token in `file`; if the file does not exist, a random token is written there, readable by its owner
    only.

    Raises:
        StorageError: the file cannot be read or created, or has no valid token.
    """
    return load_token(file) if file.exists() else _create(file)


def load_token(file: Path) -> str:
    """The token in `file`.

    Raises:
        StorageError: the file cannot be read, or has no valid token.
    """
    try:
        with file.open(encoding="utf-8") as stream:
            token = stream.read(_MAX_FILE_LENGTH).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise _unusable_file(file, f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not is_well_formed(token):
        raise _unusable_file(file, f"has no valid token ({TOKEN_RULE})")
    return token


def _create(file: Path) -> str:
    token = secrets.token_urlsafe(32)
    try:
        replace_file(file, f"{token}\n".encode())
    except OSError as error:
        raise _unusable_file(file, f"cannot be created: {error.strerror or error}") from error
    return token


def _unusable_file(file: Path, problem: str) -> StorageError:
    return StorageError(
        f"The token file {file} {problem}.",
        remedy="Delete the file to get a new token, name another file with --token-file, or set GCS_TOKEN.",
    )
