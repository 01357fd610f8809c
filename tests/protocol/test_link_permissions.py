"""Which client may close the link of a vehicle, or forward the link to another ground station."""

import pytest

from gcs_server.api import (
    command_routes,
    control_models,
    control_routes,
    models,
    offboard_routes,
    station_routes,
)
from gcs_server.errors import NotInControl, Refused, UnknownLink
from tests.protocol.api_calls import (
    ANNA,
    BOB,
    FORCED_CONTROL_REQUEST,
    START_REQUEST,
    journal_entries,
    run_with_routes,
)
from tests.protocol.offboard_testbed import sleep

CONFIRMATION = "link memory closes, vehicle 1 in flight loses its last link"


def link_names(rig):
    return [info.name for info in rig.station.router.links()]


async def close_link(rig, client, confirm=None, name="memory"):
    await station_routes.remove_link(name, rig.station, client, confirm)


def test_a_client_without_control_cannot_close_the_link_of_a_controlled_vehicle(run_simulated):
    async def scenario(rig):
        await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        for confirm in (None, CONFIRMATION):
            with pytest.raises(NotInControl, match="anna has control of vehicle 1"):
                await close_link(rig, BOB, confirm)
        assert journal_entries(rig.station)[-1] == ("bob", "links/remove", None, "not_in_control")
        setpoint_count = len(rig.autopilot.setpoints)
        await sleep(1)
        assert len(rig.autopilot.setpoints) > setpoint_count + 30  # sent at 50 Hz
        assert link_names(rig) == ["memory"]

    run_with_routes(run_simulated, scenario)


@pytest.mark.parametrize("situation", ["streaming", "armed", "armed without control"])
def test_the_last_link_in_flight_is_closed_only_with_confirmation(run_simulated, situation):
    async def scenario(rig):
        if situation == "streaming":
            await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        elif situation == "armed":
            await command_routes.mode("1", models.ModeRequest(mode="position"), rig.station, ANNA)
        for confirm in (None, "", "yes", CONFIRMATION.replace("1", "2"), CONFIRMATION.upper()):
            with pytest.raises(Refused, match="Vehicle 1 is armed or flown by setpoints") as refused:
                await close_link(rig, ANNA, confirm)
            assert refused.value.remedy == f"To close it anyway, send confirm={CONFIRMATION!r}."
        assert link_names(rig) == ["memory"]
        assert journal_entries(rig.station)[-1] == ("anna", "links/remove", None, "refused")
        await close_link(rig, ANNA, CONFIRMATION)
        assert link_names(rig) == []
        assert ("anna", "links/remove", None, "ok") in journal_entries(rig.station)

    run_with_routes(run_simulated, scenario)


def test_with_a_second_link_no_confirmation_is_needed(run_simulated):
    async def scenario(rig):
        second = rig.testbed.link("second")
        rig.testbed.offboard_autopilot(second).set_hovering()
        await sleep(8)
        assert set(rig.vehicle.links) == {"memory", "second"}
        await close_link(rig, ANNA)
        assert link_names(rig) == ["second"]

    run_with_routes(run_simulated, scenario)


def test_on_the_ground_any_client_can_close_a_link_if_no_client_has_control(run_simulated):
    async def scenario(rig):
        await close_link(rig, BOB)
        assert link_names(rig) == []
        with pytest.raises(UnknownLink):
            await close_link(rig, BOB)

    run_with_routes(run_simulated, scenario, flying=False)


def test_on_the_ground_the_link_of_a_vehicle_controlled_by_another_client_stays_open(run_simulated):
    async def scenario(rig):
        await control_routes.take("1", rig.station, ANNA, FORCED_CONTROL_REQUEST)
        with pytest.raises(NotInControl):
            await close_link(rig, BOB)
        await close_link(rig, ANNA)
        assert link_names(rig) == []

    run_with_routes(run_simulated, scenario, flying=False)


def test_the_link_of_a_vehicle_lost_in_flight_stays_open(run_simulated):
    async def scenario(rig):
        await control_routes.take("1", rig.station, ANNA, control_models.TakeControl())
        rig.testbed.router.connection("memory").link.drop_peer("peer")
        assert rig.vehicle.links == ()
        with pytest.raises(NotInControl):
            await close_link(rig, BOB)
        with pytest.raises(Refused, match="last link"):
            await close_link(rig, ANNA)

    run_with_routes(run_simulated, scenario)


def test_forwarding_is_opened_and_closed_only_by_the_client_in_control(run_simulated):
    async def scenario(rig):
        request = models.LinkRequest(url="udpin://127.0.0.1:0?forward=1", name="station")
        await command_routes.mode("1", models.ModeRequest(mode="position"), rig.station, ANNA)
        with pytest.raises(NotInControl, match="anna has control of vehicle 1"):
            await station_routes.add_link(request, rig.station, BOB)
        assert link_names(rig) == ["memory"]
        rig.testbed.link("station", forward=True)
        rig.testbed.link("other")
        with pytest.raises(NotInControl):
            await close_link(rig, BOB, name="station")
        await close_link(rig, ANNA, name="station")
        await close_link(rig, BOB, name="other")
        assert link_names(rig) == ["memory"]

    run_with_routes(run_simulated, scenario)
