"""Only its own slider confirms a question, whatever key goes down elsewhere."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import opened
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.question import Question, press_new_buttons, refuse_commands
from tests.e2e.keyboard.walk import close_all, rooms

pytestmark = [pytest.mark.browser, pytest.mark.story]

NOT_PRESSED = ("Reload", "Hold")
"""Hold asks nobody, and ends every question."""


def test_each_question_of_each_button_is_confirmed_by_its_own_slider_only(
    browser: Browser, flying: Station
) -> None:
    asked: dict[str, str] = {}
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        # Before the link's rate is known its button is called otherwise, and could not be found again.
        page.get_by_role("button", name=re.compile(r"^Link .* lost")).first.wait_for()
        commands = refuse_commands(page)
        # in the air everything; on the ground what is other there
        for vehicle_key, some in (("1", None), ("2", 1)):
            pressed: set[str] = {*NOT_PRESSED}
            for room, open_it in rooms(page)[:some]:
                close_all(page)
                page.keyboard.press(vehicle_key)
                open_it()
                page.wait_for_timeout(50)
                for where, ask in press_new_buttons(page, pressed, room):
                    question = Question(page, commands)
                    commands.clear()  # of the buttons before, which ask nothing
                    if asked.setdefault(question.title, where) == where:
                        question.check(ask)
                    else:
                        page.keyboard.press("Escape")
    for wanted in ("Disarm", "Arm", "Take off", "Land", "Return", "Offboard", "Send", "Stop motors"):
        assert any(title.startswith(wanted) for title in asked), (wanted, asked)
    assert flying.drone.status()["armed"]
