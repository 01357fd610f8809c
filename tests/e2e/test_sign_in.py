"""Sign-in with a browser: by the form, by the printed link, and by a link on another site's page."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import TIMEOUT_MS, PageMonitor, chromium, violations_in_both_themes
from tests.station import free_port, running_process, server_command, wait_for_start

pytestmark = pytest.mark.browser

OTHER_SITE = "http://elsewhere.example/"
FIRST_MESSAGE_TYPE = """
() => new Promise((done, fail) => {
  const socket = new WebSocket(`ws://${location.host}/api/v1/telemetry`);
  socket.onmessage = (event) => done(JSON.parse(event.data).type);
  socket.onerror = () => fail(new Error('refused'));
})
"""
CLICK_ON_FLIGHTS = (
    "() => [...document.querySelectorAll('nav button')].find((b) => b.innerText === 'Flights')?.click()"
)


@pytest.fixture
def sign_in_link(tmp_path: Path) -> Iterator[str]:
    """The link printed by a server that accepts connections from other machines."""
    port, output_file = free_port(socket.SOCK_STREAM), tmp_path / "output.txt"
    command = [*server_command(port, [], tmp_path), "--no-scene", "--host", "0.0.0.0"]
    with (
        output_file.open("wb") as out,
        running_process(command, stdout=out, stderr=subprocess.STDOUT) as process,
    ):
        wait_for_start(process, lambda: "Ready: " in output_file.read_text(), output_file)
        yield output_file.read_text().partition("Ready: ")[2].split()[0]


def new_page(browser: Browser, sign_in_link: str) -> tuple[Page, PageMonitor]:
    """A new page, in a browser without a cookie of this server, and its monitor."""
    page = browser.new_context(color_scheme="dark").new_page()
    page.set_default_timeout(TIMEOUT_MS)
    # Without a cookie, the 3D view would be refused.
    page.route("**/scene/**", lambda route: route.fulfill(content_type="text/plain", body=""))
    return page, PageMonitor(page, sign_in_link)


def check_and_close(page: Page, monitor: PageMonitor, expected_foreign_requests: list[str]) -> None:
    assert [text for text in monitor.console_errors if "status of 401" not in text] == []
    assert monitor.foreign_requests == expected_foreign_requests
    page.context.close()


@pytest.mark.story
def test_a_user_signs_in_by_the_form_and_by_the_link(sign_in_link: str) -> None:
    token = sign_in_link.partition("token=")[2]
    server_url = f"http://{urlsplit(sign_in_link).netloc}"
    with chromium() as browser:
        page, monitor = new_page(browser, sign_in_link)
        page.goto(f"{server_url}/docs?a=1")
        field = page.get_by_label("Token")
        expect(field).to_be_focused()
        assert violations_in_both_themes(page) == []
        field.fill("a wrong token")
        field.press("Enter")
        expect(page.get_by_role("alert")).to_contain_text("This token is not valid")
        assert violations_in_both_themes(page) == []
        field.fill(token)
        field.press("Enter")
        page.wait_for_url(f"{server_url}/docs?a=1")
        expect(page.get_by_role("heading", name="API")).to_be_visible()
        check_and_close(page, monitor, [])

        page, monitor = new_page(browser, sign_in_link)
        page.goto(sign_in_link)
        assert page.url == f"{server_url}/", (
            "the token is in the address, and so in the history and in screenshots"
        )
        assert page.evaluate(FIRST_MESSAGE_TYPE) == "hello"
        assert page.evaluate("() => document.cookie") == "", "a script can read the cookie"
        page.get_by_role("button", name="Flights", exact=True).click()  # loads the view
        page.get_by_role("button", name="Close the flights view").click()
        page.wait_for_load_state("networkidle")
        page.context.clear_cookies()  # as if the server had restarted with another token
        page.evaluate(CLICK_ON_FLIGHTS)  # no button if the page itself has already sent a request
        expect(page.get_by_label("Token")).to_be_visible()
        check_and_close(page, monitor, [])

        # A browser does not send a SameSite=Strict cookie when a page of another site opens the address.
        # The server's page then repeats the request once, with the cookie.
        page, monitor = new_page(browser, sign_in_link)
        links_html = (
            f'<a id="link" href="{sign_in_link}">fly</a><a id="docs" href="{server_url}/docs">read</a>'
        )
        page.route(f"{OTHER_SITE}**", lambda route: route.fulfill(content_type="text/html", body=links_html))
        cases = (
            ("link", f"{server_url}/", "Offboard GCS"),
            ("docs", f"{server_url}/docs", "Offboard GCS: API"),
        )
        for link_id, address, title in cases:
            page.goto(OTHER_SITE)
            page.locator(f"#{link_id}").click()
            page.wait_for_url(address)
            expect(page).to_have_title(title)
        check_and_close(
            page, monitor, [url for url in monitor.foreign_requests if url.startswith(OTHER_SITE)]
        )
