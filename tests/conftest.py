"""What every test may ask for."""

from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED = REPOSITORY.parent / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The reference data beside the checkout; tests that need it skip where it is missing."""
    if not (SHARED / "px4").is_dir():
        pytest.skip("the reference recordings (../shared) are not beside this checkout")
    return SHARED
