"""The limit of open files of the process, and the share for client connections."""

from __future__ import annotations

import logging
import resource

log = logging.getLogger(__name__)

WANTED = 4096
RESERVED = 256
"""Reserved for MAVLink links, recordings, the stream process, the journal and the page's files."""


def raise_descriptor_limit() -> int:
    """Raises the soft limit as far as useful and allowed. Returns the number of possible connections, so that
    `RESERVED` descriptors stay free.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    allowed = soft
    if soft != resource.RLIM_INFINITY and soft < WANTED:
        allowed = WANTED if hard == resource.RLIM_INFINITY else min(WANTED, hard)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))
        except (OSError, ValueError):
            allowed = soft
    if allowed == resource.RLIM_INFINITY:
        return WANTED
    if allowed < WANTED:
        log.warning(
            "This process may open %d files only (ulimit -n): fewer clients can connect at once. "
            "%d or more are better.",
            allowed,
            WANTED,
        )
    return max(allowed - RESERVED, allowed // 2)
