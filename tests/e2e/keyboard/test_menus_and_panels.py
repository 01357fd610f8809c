"""Menus and panels by keyboard: keys move only inside an open menu, Escape closes only the menu or the panel,
and the safety keys and buttons still work."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e.browser import in_both_themes, opened
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.question import await_command, refuse_commands

pytestmark = pytest.mark.browser


def opened_menu(page: Page) -> Locator:
    """The menu of "Add step", opened by keyboard."""
    page.get_by_role("button", name="Add step").press("ArrowDown")
    menu = page.get_by_role("menu")
    expect(menu.get_by_role("menuitem").first).to_be_focused()
    return menu


def test_keys_in_an_open_menu_choose_in_it_and_ask_no_flight_command(
    browser: Browser, flying: Station
) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        page.keyboard.press("w")
        menu = opened_menu(page)
        assert in_both_themes(page) == []
        for key, title in (("End", "Survey of an area"), ("ArrowUp", "Rally point"), ("t", "Take off")):
            page.keyboard.press(key)
            expect(menu.get_by_role("menuitem", name=title, exact=True)).to_be_focused()
        expect(page.get_by_role("alertdialog")).to_have_count(0)
        steps = page.get_by_role("listbox", name="Steps").get_by_role("option")
        page.keyboard.press("Enter")
        expect(steps.filter(has_text="Take off")).to_have_count(1)
        expect(menu).to_be_hidden()
        expect(page.get_by_role("button", name="Add step")).to_be_focused()


def test_escape_closes_the_menu_only_and_returns_the_focus(browser: Browser, flying: Station) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        page.keyboard.press("w")
        page.keyboard.press("y")
        checks = page.get_by_role("region", name="Readiness")
        expect(checks).to_be_visible()
        menu = opened_menu(page)
        page.keyboard.press("Escape")
        expect(menu).to_be_hidden()
        expect(page.get_by_role("button", name="Add step")).to_be_focused()
        expect(checks).to_be_visible()
        page.keyboard.press("Escape")
        expect(checks).to_be_hidden()


def test_the_safety_keys_and_the_hold_button_work_while_a_menu_is_open(
    browser: Browser, flying: Station
) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("w")
        menu = opened_menu(page)
        page.keyboard.press("h")
        await_command(page, commands, "Hold in a menu")
        assert commands.pop().endswith("/vehicles/101/hold")

        page.keyboard.press("Shift+K")
        question = page.get_by_role("alertdialog")
        expect(question.get_by_role("slider")).to_be_focused()
        expect(menu).to_be_hidden()
        page.keyboard.press("Escape")
        expect(question).to_be_hidden()

        menu = opened_menu(page)
        page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Hold").click()
        await_command(page, commands, "Hold by its button")
        assert commands.pop().endswith("/vehicles/101/hold")
        expect(menu).to_be_hidden()


def test_escape_closes_the_panel_only_and_returns_the_focus(browser: Browser, flying: Station) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        page.keyboard.press("y")
        checks = page.get_by_role("region", name="Readiness")
        expect(checks).to_be_visible()
        for name, panel_name in (
            ("Battery", "Battery: details"),
            ("You have control", "Control of 101 Quad"),
        ):
            button = page.get_by_role("button", name=name)
            button.press("Enter")
            panel = page.get_by_role("dialog", name=panel_name)
            expect(panel).to_be_visible()
            assert in_both_themes(page) == []
            page.keyboard.press("Escape")
            expect(panel).to_be_hidden()
            expect(button).to_be_focused()
            expect(checks).to_be_visible()
        page.keyboard.press("Escape")
        expect(checks).to_be_hidden()


def test_a_panel_closes_when_the_focus_leaves_it_and_hold_works_beside_it(
    browser: Browser, flying: Station
) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("c")
        panel = page.get_by_role("dialog", name="Control of 101 Quad")
        expect(panel.get_by_role("button", name="Release control")).to_be_focused()
        page.keyboard.press("h")
        await_command(page, commands, "Hold in the panel")
        assert commands.pop().endswith("/vehicles/101/hold")
        page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Hold").click()
        await_command(page, commands, "Hold by its button")
        assert commands.pop().endswith("/vehicles/101/hold")
        expect(panel).to_be_hidden()

        page.keyboard.press("c")
        expect(panel.get_by_role("button", name="Release control")).to_be_focused()
        land = page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Land", exact=True)
        land.focus()
        expect(panel).to_be_hidden()
        expect(land).to_be_focused()

        page.keyboard.press("c")
        page.keyboard.press("Shift+K")
        question = page.get_by_role("alertdialog")
        expect(question.get_by_role("slider")).to_be_focused()
        expect(panel).to_be_hidden()
        page.keyboard.press("Escape")
        expect(question).to_be_hidden()
