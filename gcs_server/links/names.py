"""Rules for the names and targets of links."""

from __future__ import annotations

import re
from urllib.parse import unquote

from gcs_server.errors import InvalidRequest

MAX_NAME_LENGTH = 64
MAX_PATH_BYTES = 1024
MAX_PATH_PART_BYTES = 255
NAME_RULE = (
    f"1 to {MAX_NAME_LENGTH} characters of A-Z, a-z, 0-9, '.', '_' and '-', the first a letter or a digit"
)
_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{MAX_NAME_LENGTH - 1}}}")
_INVALID_IN_NAME = re.compile(r"[^A-Za-z0-9._-]+")
_LOOKS_SECRET = re.compile(r"[0-9A-Fa-f]{32,}|[A-Za-z0-9_-]{43}")
"""Matches a text that could be a key: 32 bytes as hexadecimal digits or base64."""
_HOST = re.compile(r"(?=.{1,253}\Z)[A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63})*\.?")


def checked_name(name: str) -> str:
    """Returns `name` if it is valid in URLs, file names and logs.

    Raises:
        InvalidRequest: the name is not valid.
    """
    if not _NAME.fullmatch(name):
        raise InvalidRequest(
            "name", f"{_short(name)} cannot be the name of a link.", remedy=f"A name has {NAME_RULE}."
        )
    return name


def checked_key_name(name: str) -> str:
    """Returns the name of a signing key if it is valid in URLs and file names.

    Raises:
        InvalidRequest: the name is not valid. The error does not repeat the name, because it may be the key
            itself, given by mistake.
    """
    if not _NAME.fullmatch(name) or _LOOKS_SECRET.fullmatch(name):
        raise InvalidRequest(
            "key",
            "The given name of a key is not valid.",
            remedy=f"A key's name has {NAME_RULE}. Never put the key itself here: see gcs key --help.",
        )
    return name


def shown_url(url: str) -> str:
    """A link's URL for the journal and the log; anything that could be a key is hidden."""

    def hide_key(match: re.Match[str]) -> str:
        try:
            checked_key_name(unquote(match[2]))
        except InvalidRequest:
            return f"{match[1]}(not shown)"
        return match[0]

    return re.sub(r"([?&]key=)([^&#]*)", hide_key, url, flags=re.IGNORECASE)


def derived_name(text: str) -> str:
    """Derives a name for a link; `text` begins with the link's kind."""
    return _INVALID_IN_NAME.sub("-", text)[:MAX_NAME_LENGTH]


def checked_host(url: str, host: str) -> str:
    """Returns `host` if it is valid.

    Raises:
        InvalidRequest: the host is neither an IPv4 address nor a host name.
    """
    if not _HOST.fullmatch(host):
        raise InvalidRequest(
            "url",
            f"{_short(url)}: {_short(host)} is not a host.",
            remedy="Give an IPv4 address or a host name (letters, digits, '-' and '.').",
        )
    return host


def checked_path(url: str, path: str) -> str:
    """Returns the path of a device or recording if it is valid.

    Raises:
        InvalidRequest: the path is not a valid file name.
    """
    parts = path.encode(errors="replace").split(b"/")
    too_long = sum(map(len, parts)) > MAX_PATH_BYTES or max(map(len, parts)) > MAX_PATH_PART_BYTES
    if not path.isprintable() or too_long:
        raise InvalidRequest(
            "url",
            f"{_short(url)}: not a valid file name: {_short(path)}.",
            remedy="Give the path of a device or a recording.",
        )
    return path


def _short(text: str) -> str:
    return repr(text if len(text) <= 80 else f"{text[:79]}…")
