"""Fixtures and settings for all tests."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED = REPOSITORY.parent / "shared"

for profile, same_each_time in (("steady", True), ("search", False)):
    settings.register_profile(
        profile, deadline=None, derandomize=same_each_time, suppress_health_check=[HealthCheck.too_slow]
    )
settings.load_profile("steady")
"""Fixed examples, independent of the machine's load; `--hypothesis-profile=search` tries new ones."""


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference data beside the checkout; tests that need it are skipped if it is missing."""
    if not (SHARED / "px4").is_dir():
        pytest.skip("the reference recordings (../shared) are not beside this checkout")
    return SHARED
