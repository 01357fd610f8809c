"""Fixtures of the end-to-end tests: Chromium, and a station of real processes at three times real time."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from gcs_server.client import SyncGcs
from tests.e2e.browser import REPOSITORY, chromium
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.station import free_port, running_server, running_vehicles
from tools import build_page

os.environ["GCS_CLIENT_ID"] = "e2e"
"""All programs and pages of a test are one client, which has control of the vehicle, unless the test gives
one of them another id."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium for the tests of a module; builds the page first if its sources are newer.

    The browser is closed at the end of the module: Playwright's event loop runs until then, and a second one
    cannot start."""
    build_page.build(REPOSITORY)
    with chromium() as running_browser:
        yield running_browser


@pytest.fixture
def station() -> Iterator[Station]:
    """A server and one vehicle that is ready to arm."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        yield Station(url, gcs, gcs.wait_for_vehicle("101", ready=True, timeout_s=120))
