"""The list of a vehicle's modes: when the server requests it, and which names the modes get from it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.px4.modes import BY_NAME, ModeNames
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services.mode_list import ATTEMPT_EVERY_S, ATTEMPTS, EXTERNAL, ModeList

SELECTABLE, NOT_SELECTABLE = 0, d.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
MODE_ENTRY = d.MAVLink_available_modes_message.unpacker


class Vehicle:
    """A vehicle with its mode list; `sent` has the messages to the vehicle."""

    def __init__(self) -> None:
        self.now_s, self.sent = 100.0, list[Any]()
        self.mode_names = ModeNames()
        self.clock = SimpleNamespace(monotonic_s=lambda: self.now_s)
        self.identity = SimpleNamespace(system_id=1, component_id=1, software=autopilot_of(12))
        self.status = SimpleNamespace(link_lost=False)
        self.mode_list = ModeList(self)  # type: ignore[arg-type]

    def send(self, message: Any) -> bool:
        self.sent.append(message)
        return True

    def announce(self, mode: str, name: bytes, properties: int = SELECTABLE) -> None:
        self.mode_list.take(MODE_ENTRY.pack(BY_NAME[mode].custom_mode, properties, 25, 18, 0, name))

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 4)):
            self.mode_list.tick()
            self.now_s += 0.25


def flight_state(mode: str) -> FlightState:
    fields = {"custom_mode": BY_NAME[mode].custom_mode, "autopilot": d.MAV_AUTOPILOT_PX4}
    return replace(FlightState(), **fields)


def test_without_a_change_of_the_list_nothing_is_requested() -> None:
    vehicle = Vehicle()
    for _ in range(3):
        vehicle.mode_list.changed(b"\x05")
    vehicle.mode_list.entered(flight_state("hold"), flight_state("position"))
    vehicle.wait(10.0)
    assert vehicle.sent == []


def test_a_changed_list_is_requested_until_all_external_modes_have_arrived() -> None:
    vehicle = Vehicle()
    vehicle.mode_list.changed(b"\x05")
    vehicle.mode_list.changed(b"\x06")
    vehicle.wait(1.0)
    (request,) = vehicle.sent
    assert (request.command, request.param1) == (d.MAV_CMD_REQUEST_MESSAGE, d.MAVLINK_MSG_ID_AVAILABLE_MODES)
    for mode in EXTERNAL - {"external_8"}:
        vehicle.announce(mode, b"(Mode not available)", NOT_SELECTABLE)
    vehicle.wait(ATTEMPT_EVERY_S)
    assert len(vehicle.sent) == 2
    vehicle.announce("external_8", b"Inspect")
    vehicle.wait(30.0)
    assert len(vehicle.sent) == 2
    assert vehicle.mode_names.announced == {"external_8": "Inspect"}


def test_the_list_is_requested_only_a_few_times_if_the_vehicle_does_not_send_it() -> None:
    vehicle = Vehicle()
    vehicle.mode_list.entered(flight_state("hold"), flight_state("external_3"))
    vehicle.wait(60.0)
    assert len(vehicle.sent) == ATTEMPTS


def test_a_mode_that_this_server_registered_keeps_its_name_and_needs_no_list() -> None:
    vehicle = Vehicle()
    vehicle.mode_names.external["external_3"] = "Registered"
    vehicle.mode_list.entered(flight_state("hold"), flight_state("external_3"))
    vehicle.wait(5.0)
    assert vehicle.sent == []
    vehicle.announce("external_3", b"Announced")
    assert vehicle.mode_names.label(BY_NAME["external_3"]) == "Registered"


def test_while_the_link_is_lost_nothing_is_requested() -> None:
    vehicle = Vehicle()
    vehicle.status.link_lost = True
    vehicle.mode_list.entered(flight_state("hold"), flight_state("external_3"))
    vehicle.wait(5.0)
    assert vehicle.sent == []
    vehicle.status.link_lost = False
    vehicle.wait(1.0)
    assert len(vehicle.sent) == 1


@pytest.mark.parametrize(
    ("sent", "shown"),
    [
        (b"Line\0garbage", "Line"),
        (b"\x1b[2J\nLine", "[2JLine"),
        (b"\xff\xfe", "��"),
        (b"", None),
        (b" \n", None),
    ],
)
def test_a_hostile_name_is_shown_without_control_characters(sent: bytes, shown: str | None) -> None:
    vehicle = Vehicle()
    vehicle.announce("external_1", sent)
    assert vehicle.mode_names.announced.get("external_1") == shown


def test_only_external_modes_are_named_and_a_removed_mode_loses_its_name() -> None:
    vehicle = Vehicle()
    vehicle.announce("hold", b"Land")
    vehicle.announce("external_1", b"Line")
    vehicle.announce("external_1", b"(Mode not available)", NOT_SELECTABLE)
    assert vehicle.mode_names.announced == {}
    assert vehicle.mode_names.label(BY_NAME["hold"]) == "Hold"
