"""Content encodings: which compressed forms of a file a browser accepts."""

from __future__ import annotations

import re

SUFFIXES = {"br": ".br", "gzip": ".gz"}
"""Suffix of a file's compressed form for each encoding, the smallest form first. The build of the page writes
these files (`web/vite.config.ts`)."""

_REFUSED = re.compile(r"q=0(\.0*)?")


def accepted_encodings(accept_encoding: str) -> list[str]:
    """The known encodings in a request's Accept-Encoding header, the smallest form first."""
    accepted = set[str]()
    for part in accept_encoding.split(","):
        name, _, parameters = part.strip().lower().partition(";")
        if not _REFUSED.fullmatch(parameters.strip()):
            accepted.add(name.strip())
    return [name for name in SUFFIXES if name in accepted]
