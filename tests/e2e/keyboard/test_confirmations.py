"""Only the slider of a confirmation confirms it; keys pressed elsewhere do not."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import open_page
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.confirmation import Confirmation, press_new_buttons, refuse_commands
from tests.e2e.keyboard.tab_order import close_all, views_and_panels

pytestmark = [pytest.mark.browser, pytest.mark.story, pytest.mark.timeout(600)]

NOT_PRESSED = ("Reload", "Hold", "Deutsch")
"""Hold has no confirmation, and closes every open confirmation. Deutsch loads the page again in German, where
this test finds no "Cancel"."""


def test_each_confirmation_of_each_button_is_confirmed_only_by_its_own_slider(
    browser: Browser, flying_station: Station
) -> None:
    confirmations: dict[str, str] = {}
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        # Wait for the link's rate, because the name of its button changes when the rate becomes known.
        page.get_by_role("button", name=re.compile(r"^Link .* loss")).first.wait_for()
        commands = refuse_commands(page)
        # all views of the flying vehicle 101; of the landed vehicle 102 only the view whose buttons differ
        for vehicle_key, view_count in (("1", None), ("2", 1)):
            pressed: set[str] = {*NOT_PRESSED}
            for view, open_view in views_and_panels(page)[:view_count]:

                def open_again(
                    vehicle_key: str = vehicle_key, open_view: Callable[[], None] = open_view
                ) -> None:
                    close_all(page)
                    page.keyboard.press(vehicle_key)
                    open_view()
                    page.wait_for_timeout(50)

                open_again()
                reopen = open_again if view == "map point menu" else None
                for button_and_view, press_button in press_new_buttons(page, pressed, view, reopen):
                    confirmation = Confirmation(page, commands)
                    commands.clear()  # commands of previous buttons that have no confirmation
                    if confirmations.setdefault(confirmation.title, button_and_view) == button_and_view:
                        confirmation.check(press_button)
                    else:
                        page.keyboard.press("Escape")
    for title_start in (
        "Disarm",
        "Arm",
        "Take off",
        "Land",
        "Return",
        "Start Offboard",
        "Send",
        "Stop motors",
    ):
        assert any(title.startswith(title_start) for title in confirmations), (title_start, confirmations)
    assert flying_station.drone.status()["armed"]
