"""Links by clicks: added, seen with counters, removed; the last link of a flying vehicle after a warning."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import free_port, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]


def names(station: Station) -> list[str]:
    return [link["name"] for link in station.gcs.request("GET", "/links")["links"]]


def test_a_link_is_added_and_removed_and_that_of_a_flying_vehicle_only_after_a_warning(
    browser: Browser, station: Station
) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    (own,) = names(station)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        page.keyboard.press("Shift+U")
        page.get_by_role("radio", name="Links", exact=True).click()
        first = page.get_by_label(f"Link {own}", exact=True)
        expect(first).to_contain_text("0 lost")
        assert serious_violations(page) == []

        page.get_by_label("Address", exact=True).fill("udp:nowhere")
        page.get_by_role("button", name="Add the link").click()
        expect(page.get_by_role("alert")).to_contain_text("udpin://")
        assert names(station) == [own]
        page.get_by_label("Address", exact=True).fill(f"udpin://127.0.0.1:{free_port()}")
        page.get_by_label("Name", exact=True).fill("spare")
        page.get_by_role("button", name="Add the link").click()
        spare = page.get_by_label("Link spare", exact=True)
        expect(spare).to_be_visible()
        assert sorted(names(station)) == sorted([own, "spare"])
        spare.get_by_role("button", name="Remove spare").click()
        expect(spare).to_have_count(0)

        first.get_by_role("button", name=f"Remove {own}").click()
        warning = first.get_by_role("alert")
        expect(warning).to_contain_text("101")
        assert names(station) == [own], "nothing is removed before the second press"
        first.get_by_role("button", name="Keep").click()
        expect(warning).to_have_count(0)
        assert drone.status()["mode"] == "hold"
        first.get_by_role("button", name=f"Remove {own}").click()
        first.get_by_role("button", name="Remove although the vehicle loses it").click()
        wait_until(lambda: names(station) == [], "the removal")
        expect(page.get_by_text("No link. Without one no vehicle can connect.")).to_be_visible()
