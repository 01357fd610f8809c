"""Two operators with one vehicle: one requests control, the other grants it, and later takes it by force."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from gcs_server.client import NotInControl, SyncGcs
from tests.e2e.browser import chromium, confirm_by_space_bar, open_page, violations_in_both_themes
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.realtime]


@pytest.fixture
def url() -> Iterator[str]:
    """A server and a vehicle, which need not be ready to fly."""
    port = free_port()
    with running_server([f"udpin://127.0.0.1:{port}"]) as (url, _), running_vehicles(port):
        yield url


def set_name(page: Page, name: str) -> None:
    page.get_by_title("Who may command this vehicle (C)").click()
    page.get_by_role("button", name="Change your name…").click()
    name_field = page.get_by_label("Your name, as others see it")
    name_field.fill(name)
    name_field.press("Enter")
    page.get_by_role("button", name="Close the settings").click()
    expect(name_field).to_be_hidden()


def test_a_command_needs_control_which_is_requested_granted_and_taken_by_force(url: str) -> None:
    with chromium() as browser, open_page(browser, url, scene=False, client_id="anna's tab") as anna:
        with open_page(browser, url, scene=False, client_id="bob's tab") as bob:
            for page, name in ((anna, "Anna"), (bob, "Bob")):
                expect(page.get_by_text("Control: nobody")).to_be_visible()
                set_name(page, name)
            anna.keyboard.press("c")
            anna.get_by_role("button", name="Take control").click()
            expect(anna.get_by_role("button", name="You have control")).to_be_visible()
            expect(bob.get_by_role("button", name="Anna has control")).to_be_visible()

            # Bob has no control: the page says why Arm is refused and what to do. Hold needs no control.
            bob.get_by_role("button", name="Arm", exact=True).click()
            alert = bob.get_by_role("alert").filter(has_text="Another client has control")
            expect(alert).to_contain_text("Anna has control of this vehicle. Request control")
            bob.keyboard.press("h")
            notice = anna.get_by_text("Bob commanded Hold of vehicle 101; Anna still has control.")
            expect(notice).to_be_visible()

            # Bob requests control by keyboard, with a reason. While Anna is connected, he cannot use force.
            bob.keyboard.press("c")
            expect(bob.get_by_text("Anna is connected, so request control first.")).to_be_visible()
            expect(bob.get_by_role("button", name="Take control by force…")).to_be_hidden()
            assert violations_in_both_themes(bob) == []
            bob.get_by_label("Reason for the request (shown to Anna)").fill("I see it better")
            bob.get_by_role("button", name="Request control").click()
            prompt = anna.get_by_role("region", name="Control requested")
            expect(prompt).to_contain_text("Bob requests control")
            expect(prompt).to_contain_text("I see it better")
            anna.keyboard.press("Escape")
            assert violations_in_both_themes(anna) == []
            anna.keyboard.press("g")
            expect(bob.get_by_role("dialog")).to_contain_text("You have control")
            expect(anna.get_by_role("button", name="Bob has control")).to_be_visible()
            expect(prompt).to_be_hidden()

            # a program is a separate client
            with SyncGcs(url, client="script", client_id="a script") as gcs:
                with pytest.raises(NotInControl, match="Bob has control"):
                    gcs.vehicle("101").set_mode("position")
                gcs.vehicle("101").hold()

        # Bob's page is closed: Bob cannot reply to a request, so Anna can take control by force.
        with SyncGcs(url, client="look") as gcs:
            wait_until(lambda: not gcs.vehicle("101").control.show()["can_be_asked"], "Bob to leave")
        anna.keyboard.press("c")
        anna.get_by_role("button", name="Take control by force…").click()
        expect(anna.get_by_role("alertdialog")).to_contain_text("Bob loses control and is notified")
        confirm_by_space_bar(anna)
        expect(anna.get_by_role("button", name="You have control")).to_be_visible()
        with SyncGcs(url, client="look") as gcs:
            journal_entries = gcs.request("GET", "/journal")["entries"]
        take = next(entry for entry in journal_entries if entry["command"] == "control/take")
        assert (take["client"], take["arguments"]["force"], take["result"]) == ("Anna", True, "ok")

        # the same tab after a reload is the same client
        anna.reload()
        expect(anna.get_by_role("button", name="You have control")).to_be_visible()
