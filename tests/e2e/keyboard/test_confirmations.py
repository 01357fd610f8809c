"""A confirmation is given only with its own slider, not by keys pressed elsewhere."""

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

NOT_PRESSED = ("Reload", "Hold")
"""Hold has no confirmation, and closes every open one."""


def test_each_confirmation_of_each_button_is_confirmed_only_by_its_own_slider(
    browser: Browser, flying: Station
) -> None:
    confirmations: dict[str, str] = {}
    with open_page(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        # The name of the button contains the link's rate: it changes when the rate becomes known.
        page.get_by_role("button", name=re.compile(r"^Link .* packet loss")).first.wait_for()
        commands = refuse_commands(page)
        # vehicle 101 flies: all views; vehicle 102 is on the ground: only the view with other buttons
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
                for where, request in press_new_buttons(page, pressed, view, reopen):
                    confirmation = Confirmation(page, commands)
                    commands.clear()  # of the previous buttons, which have no confirmation
                    if confirmations.setdefault(confirmation.title, where) == where:
                        confirmation.check(request)
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
    assert flying.drone.status()["armed"]
