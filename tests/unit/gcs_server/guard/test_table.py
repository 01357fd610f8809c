"""The tables of what a guard passes are whole, and address what they pass."""

from __future__ import annotations

import math

from gcs_server.control.commands import BY_NAME
from gcs_server.guard import table
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.tables import LAYOUTS, TARGET_SYSTEM_OFFSET
from gcs_server.vehicle.services.raw_messages import PURPOSE_MADE, PURPOSE_MADE_COMMANDS

NAMES = {layout.name for layout in LAYOUTS.values()}


def test_every_rule_names_a_message_and_a_row():
    assert not table.MESSAGES.keys() - NAMES
    rules = [*table.MESSAGES.values(), *table.COMMANDS.values(), table.OTHER_COMMANDS, table.FTP_WRITING]
    assert all(rule.row in BY_NAME for rule in rules if rule.way in ("command", "input", "part"))
    assert all(rule.why for rule in rules if rule.way in ("refused", "kept"))


def test_what_has_a_purpose_made_command_is_never_passed_as_reading():
    """A message that a person may not send by hand is not passed to a vehicle without control either."""
    passed = {name for name in PURPOSE_MADE if table.MESSAGES.get(name, table.NOT_PASSED) == table.READ}
    assert passed == {"LOG_REQUEST_LIST", "LOG_REQUEST_DATA"}
    commands = {number: table.COMMANDS.get(number, table.OTHER_COMMANDS) for number in PURPOSE_MADE_COMMANDS}
    assert not [number for number, rule in commands.items() if rule.way in ("read", "kept", "sensor")]


def test_commands_that_stop_need_no_control_and_others_do():
    def row(command, *params):
        return table.row_of_command(command, (*params, *(0.0,) * (7 - len(params))))[0].row

    arm, mode = d.MAV_CMD_COMPONENT_ARM_DISARM, d.MAV_CMD_DO_SET_MODE
    assert row(arm, 1.0) == "arm"
    assert row(arm, 0.0) == "disarm"
    assert row(arm, 0.0, 21196.0) == "kill"
    assert row(arm, math.nan) == "disarm"
    assert [row(mode, 1.0, 4.0, sub) for sub in (3.0, 6.0, 5.0, 4.0)] == ["hold", "land_now", "rtl", "mode"]
    assert row(mode, 1.0, 6.0) == "offboard/start"
    assert row(d.MAV_CMD_DO_PAUSE_CONTINUE, 0.0) == "hold"
    assert row(d.MAV_CMD_DO_PAUSE_CONTINUE, 1.0) == "mission/start"
    open_rows = {name for name, command in BY_NAME.items() if command.control == "open"}
    assert {"hold", "land_now", "kill"} <= open_rows


def test_the_component_follows_the_system_in_every_addressed_message():
    """`Guard` exchanges both bytes at once."""
    for msg_id, offset in TARGET_SYSTEM_OFFSET.items():
        fields, lengths = LAYOUTS[msg_id].fields, LAYOUTS[msg_id].lengths
        if "target_component" in fields:
            at = fields.index("target_system")
            assert fields[at + 1] == "target_component", LAYOUTS[msg_id].name
            assert lengths[at] == 1
            assert offset >= 0
