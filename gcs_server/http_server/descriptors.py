"""The process's limit of open files, and the part of it for client connections."""

from __future__ import annotations

import logging
import resource

log = logging.getLogger(__name__)

WANTED = 4096
"""Limit of open files that is sufficient for all clients."""
RESERVED = 256
"""Descriptors reserved for MAVLink links, recordings, the stream process, the journal and the page's
files."""


def raise_descriptor_limit() -> int:
    """Raises the process's soft limit to `WANTED`, or to a lower hard limit. Returns the number of client
    connections that leave `RESERVED` descriptors free.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = soft
    if soft != resource.RLIM_INFINITY and soft < WANTED:
        limit = WANTED if hard == resource.RLIM_INFINITY else min(WANTED, hard)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))
        except (OSError, ValueError):
            limit = soft
    if limit == resource.RLIM_INFINITY:
        return WANTED
    if limit < WANTED:
        log.warning(
            "This process may open %d files only (ulimit -n): fewer clients can connect at once. "
            "%d or more are better.",
            limit,
            WANTED,
        )
    return max(limit - RESERVED, limit // 2)
