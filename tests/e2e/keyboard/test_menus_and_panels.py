"""Menus, lists and panels by keyboard: keys select entries of the open menu or list, Escape closes only the
menu, list or panel, and the safety keys and buttons still work."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e.browser import open_page, violations_in_both_themes
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.confirmation import await_command, refuse_commands

pytestmark = [pytest.mark.browser, pytest.mark.story]


def add_item_button(page: Page) -> Locator:
    """The button in the plan view that opens the menu of items."""
    return page.get_by_role("button", name="Add item")


def open_item_menu(page: Page) -> Locator:
    """Opens the menu of "Add item" by keyboard."""
    add_item_button(page).press("ArrowDown")
    menu = page.get_by_role("menu")
    expect(menu.get_by_role("menuitem").first).to_be_focused()
    return menu


def setpoint_type_button(page: Page) -> Locator:
    """The button in the offboard view that opens the list of setpoint types."""
    return page.get_by_role("combobox", name="Setpoint type")


def open_type_list(page: Page) -> Locator:
    """Opens the list of setpoint types by keyboard."""
    setpoint_type_button(page).press("ArrowDown")
    type_list = page.get_by_role("listbox", name="Setpoint types")
    expect(type_list).to_be_visible()
    return type_list


def open_control_panel(page: Page) -> Locator:
    """Opens the panel about control of the vehicle by keyboard."""
    page.keyboard.press("c")
    panel = page.get_by_role("dialog", name="Control of Quad 101")
    expect(panel.get_by_role("button", name="Release control")).to_be_focused()
    return panel


def open_readiness_panel(page: Page) -> Locator:
    """Opens the readiness panel, which Escape closes only if no menu, list or panel is open over it."""
    page.keyboard.press("y")
    readiness_panel = page.get_by_role("region", name="Readiness")
    expect(readiness_panel).to_be_visible()
    return readiness_panel


def check_escape(page: Page, overlay: Locator, button: Locator, readiness_panel: Locator) -> None:
    """Checks that Escape closes only the overlay, and returns the focus to the overlay's button."""
    page.keyboard.press("Escape")
    expect(overlay).to_be_hidden()
    expect(button).to_be_focused()
    expect(readiness_panel).to_be_visible()


def test_keys_in_an_open_menu_select_its_entries_and_request_no_flight_command(
    browser: Browser, flying_station: Station
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        page.keyboard.press("w")
        menu = open_item_menu(page)
        assert violations_in_both_themes(page) == []
        for key, title in (("End", "Older commands"), ("ArrowUp", "Mission flow"), ("t", "Take off")):
            page.keyboard.press(key)
            expect(menu.get_by_role("menuitem", name=title, exact=True)).to_be_focused()
        expect(page.get_by_role("alertdialog")).to_have_count(0)
        items = page.get_by_role("listbox", name="Items").get_by_role("option")
        page.keyboard.press("Enter")
        expect(items.filter(has_text="Take off")).to_have_count(1)
        expect(menu).to_be_hidden()
        expect(add_item_button(page)).to_be_focused()


def test_keys_in_an_open_list_select_its_entries_and_request_no_flight_command(
    browser: Browser, flying_station: Station
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("p")
        type_list = open_type_list(page)
        assert violations_in_both_themes(page) == []
        for key, name in (("End", "Motors"), ("Home", "Position"), ("t", "Trajectory"), ("l", "Trajectory")):
            page.keyboard.press(key)
            expect(type_list.locator("[data-highlighted]")).to_contain_text(name)
        page.keyboard.press("Enter")
        expect(type_list).to_be_hidden()
        expect(setpoint_type_button(page)).to_be_focused()
        expect(setpoint_type_button(page)).to_contain_text("Trajectory point")
        expect(page.get_by_role("alertdialog")).to_have_count(0)
        page.keyboard.press("l")  # while the list is closed, the page handles the keys
        expect(page.get_by_role("alertdialog")).to_contain_text("Land")
        assert commands == []


def test_arrow_keys_select_an_option_of_a_radio_group_that_is_one_tab_stop(
    browser: Browser, flying_station: Station
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        page.keyboard.press("p")
        input_selector = page.get_by_role("radiogroup", name="Setpoint input")
        form, group = (
            input_selector.get_by_role("radio", name=name, exact=True) for name in ("Form", "Group")
        )
        form.focus()
        page.keyboard.press("ArrowLeft")
        expect(group).to_be_focused()
        expect(group).to_be_checked()
        expect(page.get_by_role("radiogroup", name="Motion of the group")).to_be_visible()
        page.keyboard.press("Shift+Tab")
        expect(page.get_by_role("button", name="Close the offboard view")).to_be_focused()
        page.keyboard.press("Tab")
        expect(group).to_be_focused()
        page.keyboard.press("ArrowRight")
        expect(form).to_be_checked()
        expect(setpoint_type_button(page)).to_be_visible()


def test_escape_closes_only_the_menu_list_or_panel_and_returns_the_focus_to_its_button(
    browser: Browser, flying_station: Station
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        for view_key, button, open_overlay in (
            ("w", add_item_button, open_item_menu),
            ("p", setpoint_type_button, open_type_list),
        ):
            page.keyboard.press(view_key)
            readiness_panel = open_readiness_panel(page)
            check_escape(page, open_overlay(page), button(page), readiness_panel)
            page.keyboard.press("Escape")
            expect(readiness_panel).to_be_hidden()
        readiness_panel = open_readiness_panel(page)
        for name, panel_name in (
            ("Battery", "Battery: details"),
            ("You have control", "Control of Quad 101"),
        ):
            button = page.get_by_role("button", name=name)
            button.press("Enter")
            panel = page.get_by_role("dialog", name=panel_name)
            expect(panel).to_be_visible()
            assert violations_in_both_themes(page) == []
            check_escape(page, panel, button, readiness_panel)
        page.keyboard.press("Escape")
        expect(readiness_panel).to_be_hidden()


@pytest.mark.parametrize(
    ("view_key", "open_overlay"),
    [("w", open_item_menu), ("p", open_type_list), (None, open_control_panel)],
    ids=["menu", "list", "panel"],
)
def test_the_safety_keys_and_the_hold_button_work_while_a_menu_list_or_panel_is_open(
    browser: Browser, flying_station: Station, view_key: str | None, open_overlay: Callable[[Page], Locator]
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        expect(page.get_by_role("button", name="You have control")).to_be_visible()
        commands = refuse_commands(page)
        if view_key is not None:
            page.keyboard.press(view_key)
        overlay = open_overlay(page)
        page.keyboard.press("h")
        await_command(page, commands, "Hold by its key")
        assert commands.pop().endswith("/vehicles/101/hold")

        page.keyboard.press("Shift+K")
        confirmation = page.get_by_role("alertdialog")
        expect(confirmation.get_by_role("slider")).to_be_focused()
        expect(overlay).to_be_hidden()
        page.keyboard.press("Escape")
        expect(confirmation).to_be_hidden()

        overlay = open_overlay(page)
        page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Hold").click()
        await_command(page, commands, "Hold by its button")
        assert commands.pop().endswith("/vehicles/101/hold")
        expect(overlay).to_be_hidden()


def test_a_panel_closes_when_the_focus_leaves_it(browser: Browser, flying_station: Station) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        expect(page.get_by_role("button", name="You have control")).to_be_visible()
        panel = open_control_panel(page)
        land = page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Land", exact=True)
        land.focus()
        expect(panel).to_be_hidden()
        expect(land).to_be_focused()


def test_the_search_finds_actions_views_plans_and_parameters_and_commands_only_after_a_confirmation(
    browser: Browser, flying_station: Station
) -> None:
    flying_station.gcs.plans().create("Zigzag at dawn", {})
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        search = page.get_by_role("combobox", name="Find an action")
        chosen = page.get_by_role("region", name="Find", exact=True).locator("[aria-selected=true]")

        def find(text: str) -> None:
            page.keyboard.press("Control+k")
            expect(search).to_be_focused()
            page.keyboard.type(text)

        find("land")
        expect(chosen).to_contain_text("Land")
        assert violations_in_both_themes(page) == []
        page.keyboard.press("Enter")
        expect(search).to_be_hidden()
        expect(page.get_by_role("alertdialog").get_by_role("slider")).to_be_focused()
        page.keyboard.press("Escape")
        assert commands == []

        find("zigzag")
        expect(chosen).to_contain_text("Zigzag at dawn")
        page.keyboard.press("Enter")
        expect(page.get_by_label("Name of the plan")).to_have_value("Zigzag at dawn")

        find("nothing of this name")
        expect(page.get_by_role("region", name="Find", exact=True)).to_contain_text("Nothing has")
        page.keyboard.press("Escape")
        expect(search).to_be_hidden()
        find("view fly")
        page.keyboard.press("Enter")
        expect(page.get_by_label("Attitude and heading")).to_be_visible()
        assert commands == []
