"""An agent asks for a flight, and a person allows it on the page, overrules it and lets it continue."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import confirm_by_slider, open_page, violations_in_both_themes
from tests.e2e.fast_station import FAST_OPTIONS
from tests.station import free_port, running_vehicles, wait_until
from tests.support.agent_client import OutsideAgent, server_with_agent

pytestmark = [pytest.mark.browser, pytest.mark.story]


@pytest.fixture
def flyer(tmp_path: Path) -> Iterator[tuple[OutsideAgent, SyncGcs]]:
    """An agent that may ask for flights, and a program; the vehicle is not proven to be simulated."""
    port = free_port()
    with (
        server_with_agent(tmp_path, "flyer=fly", [f"udpin://127.0.0.1:{port}"]) as url,
        running_vehicles(port, arguments=FAST_OPTIONS),
        SyncGcs(url, client="observer") as gcs,
    ):
        gcs.wait_for_vehicle("101", ready=True)
        yield OutsideAgent(url, tmp_path, "flyer"), gcs


def asked(agent: OutsideAgent, gcs: SyncGcs) -> str:
    """Id of a request for the flight of a new plan."""
    position = gcs.vehicle("101").topic("global_position")
    place = {"lat_deg": position["lat_deg"], "lon_deg": position["lon_deg"]}
    height = {"value_m": 8, "reference": "home"}
    items = [
        {"kind": "takeoff", **place, "altitude": height},
        {"kind": "waypoint", **place, "lat_deg": place["lat_deg"] + 0.0003, "altitude": height},
        {"kind": "land", **place, "altitude": {"value_m": 0, "reference": "home"}},
    ]
    plan = agent.done("plans_create", name="there and back", plan={"items": items})
    operation = agent.done("dry_runs_start", plan_id=plan["id"], vehicle="101")
    ended = agent.done("wait", until="operation_ended", operation_id=operation["id"], at_most_s=50)
    return agent.done("request_flight", dry_run_id=ended["result"]["dry_run"])["id"]


def test_a_person_refuses_and_allows_the_flight_of_an_agent(
    browser: Browser, flyer: tuple[OutsideAgent, SyncGcs]
) -> None:
    agent, gcs = flyer
    drone = gcs.vehicle("101")
    assert "not proven" in agent.call("takeoff", vehicle="101", alt_home_m=5)["why"]
    with open_page(browser, agent.url, size=(1280, 800), scene=False) as page:
        card = page.get_by_role("region", name="Agent flyer")
        expect(card).to_contain_text("May ask to fly")
        refused = asked(agent, gcs)
        expect(card).to_contain_text("Asks to fly “there and back”, version 1")
        assert violations_in_both_themes(page) == []
        card.get_by_role("button", name="Refuse").click()
        expect(card).to_contain_text("has refused the flight")
        answer = agent.done("wait", until="request_answered", request_id=refused, at_most_s=10)
        assert answer["state"] == "refused"
        allowed = asked(agent, gcs)
        allow = card.get_by_role("button", name="Allow the flight…")
        allow.click()
        dialog = page.get_by_role("alertdialog")
        expect(dialog).to_contain_text("Agent flyer has control")
        page.keyboard.press("Enter")  # a key that was meant for something else
        assert not drone.status()["armed"]
        confirm_by_slider(page, allow.click)
        answer = agent.done("wait", until="request_answered", request_id=allowed, at_most_s=50)
        assert answer["state"] == "started", answer
        expect(card).to_contain_text("Has control")
        agent.done("wait", until="in_air", vehicle="101", at_most_s=40)
        page.get_by_role("button", name="Hold", exact=True).first.click()
        expect(card).to_contain_text("Overruled", timeout=20_000)
        wait_until(lambda: drone.status()["mode"] == "hold", "Hold")
        let_continue = card.get_by_role("button", name="Let it continue")
        let_continue.click()
        confirm_by_slider(page, let_continue.click)
        expect(card).not_to_contain_text("Overruled")
        agent.done("land", vehicle="101")
        drone.until_disarmed(timeout_s=60)
