"""Before somebody chooses a source of maps or heights, nothing leaves this machine: no socket of server and
its processes, and no request of the page, goes anywhere but to loopback."""

from __future__ import annotations

import ipaddress
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import open_page
from tests.e2e.fast_station import FAST_OPTIONS
from tests.e2e.keyboard.tab_order import close_all, views_and_panels
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

HOOK = '''
"""Writes down every address that this process connects or sends to, and refuses all but loopback."""
import os, sys

def _watch(event, arguments):
    if event in ("socket.connect", "socket.sendto", "socket.sendmsg"):
        address = arguments[1]
        host = address[0] if isinstance(address, tuple) and address else None
    elif event in ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr"):
        host = arguments[0]
    else:
        return
    if host is None:  # a socket of this machine, or an address that was connected before
        return
    host = host.decode() if isinstance(host, bytes) else str(host)
    descriptor = os.open(os.environ["GCS_TEST_ADDRESSES"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(descriptor, f"{event} {host}\\n".encode())
    os.close(descriptor)
    if not host.startswith("127.") and host not in ("", "localhost", "::1", "0.0.0.0", "::"):
        raise OSError(101, f"the test refuses {event} of {host}")

sys.addaudithook(_watch)
'''


class Addresses:
    """The addresses that the processes of a server have used."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def all(self) -> set[str]:
        lines = self._file.read_text(encoding="utf-8").splitlines() if self._file.exists() else []
        return {line.partition(" ")[2] for line in lines}

    def foreign(self) -> set[str]:
        return {host for host in self.all() if not is_loopback(host)}


def is_loopback(host: str) -> bool:
    if host in ("", "localhost"):
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    return address.is_loopback or address.is_unspecified


@pytest.fixture
def addresses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Addresses:
    """Every Python process that is started meanwhile writes down its addresses."""
    folder = tmp_path / "hook"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(HOOK, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=":")
    monkeypatch.setenv("GCS_TEST_ADDRESSES", str(tmp_path / "addresses"))
    return Addresses(tmp_path / "addresses")


def test_nothing_leaves_the_machine_before_a_source_is_chosen(browser: Browser, addresses: Addresses) -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=2, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        gcs.wait_for_vehicle("101", ready=True, timeout_s=120).takeoff(10)
        with open_page(browser, url) as page:  # fails at any request to another address
            expect(page.get_by_title("3D view", exact=True)).to_be_visible()
        with open_page(browser, url, scene=False) as page:
            expect(page.locator(".pill b")).to_have_text("Holding")
            views = views_and_panels(page)
            assert len(views) > 15
            for name, open_view in views:
                open_view()
                page.wait_for_timeout(300)  # what a view asks for
                assert not addresses.foreign(), name
                close_all(page)
        assert addresses.all(), "the server's sockets were not watched"

        # The same watch sees the first tile of a source that somebody has chosen.
        with httpx.Client(base_url=f"{url}/api/v1", headers={"X-Client-Id": "e2e"}, timeout=60) as http:
            assert http.put("/map_sources/chosen", json={"source": "osm"}).is_success
            assert not addresses.foreign(), "choosing alone asks for nothing"
            assert http.get("/map_sources/osm/3/4/2").status_code == 502
        wait_until(
            lambda: addresses.foreign() == {"tile.openstreetmap.org"}, "the address of the chosen source"
        )
