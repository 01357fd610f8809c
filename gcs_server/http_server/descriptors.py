"""The process's limit of open files, and the part of it for client connections."""

from __future__ import annotations

import logging
import resource

log = logging.getLogger(__name__)

WANTED_LIMIT = 4096
"""Limit of open files that is sufficient for all clients."""
RESERVED = 256
"""Descriptors reserved for MAVLink links, recordings, the stream process, the journal and the page's
files."""


def raise_descriptor_limit() -> int:
    """Raises the process's soft limit to `WANTED_LIMIT`, or to a lower hard limit. Returns the number of
    client connections that leave `RESERVED` descriptors free.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = soft
    if soft != resource.RLIM_INFINITY and soft < WANTED_LIMIT:
        limit = WANTED_LIMIT if hard == resource.RLIM_INFINITY else min(WANTED_LIMIT, hard)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))
        except (OSError, ValueError):
            limit = soft
    if limit == resource.RLIM_INFINITY:
        return WANTED_LIMIT
    if limit < WANTED_LIMIT:
        log.warning(
            "This process may open %d files only (ulimit -n): fewer clients can connect at once. "
            "%d or more are better.",
            limit,
            WANTED_LIMIT,
        )
    return max(limit - RESERVED, limit // 2)
