"""Parameter lists with false, repeated or endless values: the read ends with an error, and the response stays
valid JSON."""

import asyncio
import json
import struct

import pytest

from gcs_server.api import param_routes
from gcs_server.errors import NoReply
from gcs_server.mavlink.codec import encode_frame
from gcs_server.vehicle.param_table import MAX_PARAMETERS
from gcs_server.vehicle.services.param_list import READ_TIMEOUT_S
from tests.protocol.one_vehicle import run_scenario

NAN = b"\0\0\xc0\x7f"
REAL32, INT32 = 9, 6


class HostileParams:
    """Sends `replies` for each request of the list or of an index, at intervals of `reply_interval_s`.
    `checksum`: the bytes of _HASH_CHECK, None: no reply to its request."""

    def __init__(self, autopilot, replies, *, checksum=None, reply_interval_s=None) -> None:
        self.autopilot, self.replies, self.checksum, self.reply_interval_s = (
            autopilot,
            replies,
            checksum,
            reply_interval_s,
        )
        self.requests = 0
        autopilot.handlers.append(self.handle)

    def handle(self, message) -> bool:
        message_type = message.get_type()
        if message_type == "PARAM_REQUEST_READ" and message.param_id == "_HASH_CHECK":
            if self.checksum is not None:
                self.send_value(b"_HASH_CHECK", 65535, 929, self.checksum, REAL32)
            return True
        if message_type not in ("PARAM_REQUEST_LIST", "PARAM_REQUEST_READ"):
            return False
        self.requests += 1
        for n, value in enumerate(self.replies()):
            if self.reply_interval_s is None:
                self.send_value(*value)
            else:
                self.autopilot.loop.call_later(n * self.reply_interval_s, self.send_value, *value)
        return True

    def send_value(self, name, index, count, bits=NAN, param_type=REAL32) -> None:
        payload = bits + struct.pack("<HH16sB", count, index, name, param_type)
        self.autopilot.send_raw(encode_frame(22, payload, self.autopilot.mav.seq, self.autopilot.system, 1))


def check_refresh(run_simulated, replies, check, *, raises=None, **options):
    async def scenario(testbed, vehicle, autopilot):
        hostile = HostileParams(autopilot, replies, **options)
        began_s = testbed.loop.time()
        if raises is None:
            await vehicle.params.refresh()
        else:
            with pytest.raises(NoReply, match=raises):
                await vehicle.params.refresh()
        assert testbed.loop.time() - began_s < READ_TIMEOUT_S + 60
        await check(vehicle, hostile)

    run_scenario(run_simulated, scenario)


async def response_of(vehicle):
    """The response of `GET …/params`."""
    response = await param_routes.all_params(vehicle)
    return json.loads(response.body, parse_constant=pytest.fail)


async def no_check(*_):
    pass


def test_a_list_that_claims_65535_parameters_is_not_read(run_simulated):
    async def check(vehicle, hostile):
        assert vehicle.params.list.state == "failed"
        assert hostile.requests == 1

    check_refresh(run_simulated, lambda: [(b"A", 0, 65535)], check, raises="reports 65,535")


def test_a_list_that_repeats_one_parameter_endlessly_is_cancelled(run_simulated):
    check_refresh(
        run_simulated,
        lambda: [(b"A", 0, 5)] * 6000,
        no_check,
        raises="repeats values",
        reply_interval_s=0.001,
    )


@pytest.mark.story
def test_a_list_that_never_completes_is_cancelled(run_simulated):
    check_refresh(
        run_simulated,
        lambda: [(b"A", 0, 5)] * 2000,
        no_check,
        raises="not complete within",
        reply_interval_s=0.45,
    )


def test_a_list_that_changes_its_length_is_cancelled(run_simulated):
    check_refresh(
        run_simulated, lambda: [(b"A", n, 5 + n) for n in range(5)], no_check, raises="changed in number"
    )


def test_the_response_is_valid_json_for_any_bit_patterns_of_values_and_names(run_simulated):
    names = [b"OK", b"\xff\xfe\xfd", b"A\0B", b'"},{"', b"\x01\x02", b"NAN", b"INF", b"", b"A" * 16]
    bits = [bytes(4), NAN, NAN, NAN, NAN, NAN, b"\0\0\x80\x7f", NAN, b"\xff\xff\x7f\x7f"]

    async def check(vehicle, _):
        response = await response_of(vehicle)
        assert response["list"]["state"] == "ready"
        assert response["list"]["left_out"] == 4
        values = {p["name"]: p["value"] for p in response["params"]}
        assert sorted(values) == ["A", "A" * 16, "INF", "NAN", "OK"]
        assert values["NAN"] is values["INF"] is None

    replies = [(n, i, len(names), b) for i, (n, b) in enumerate(zip(names, bits, strict=True))]
    check_refresh(run_simulated, lambda: replies, check)


def test_a_checksum_that_is_not_a_number_counts_as_missing(run_simulated):
    async def check(vehicle, _):
        assert vehicle.params.list.state == "ready"
        assert vehicle.params.list.hash is None

    check_refresh(run_simulated, lambda: [(b"A", 0, 1)], check, checksum=NAN)


def test_endless_unrequested_parameters_are_limited_and_encoded_in_small_parts(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        hostile = HostileParams(autopilot, lambda: [(b"A", 0, 1)])
        await vehicle.params.refresh()
        for n in range(MAX_PARAMETERS + 1000):
            hostile.send_value(b"P%d" % n, 65535, 1)
        await testbed.clock.sleep(2)
        assert len(vehicle.params.all()) == MAX_PARAMETERS
        encoded_count, max_encoded_count = [0], [0]
        original_view = param_routes.param_view

        def count_view(*arguments):
            encoded_count[0] += 1
            max_encoded_count[0] = max(max_encoded_count[0], encoded_count[0])
            return original_view(*arguments)

        run_once = testbed.loop._run_once

        def run_iteration():
            encoded_count[0] = 0
            run_once()

        testbed.loop._run_once = run_iteration
        param_routes.param_view = count_view
        try:
            response = await param_routes.all_params(vehicle)
        finally:
            param_routes.param_view = original_view
            testbed.loop._run_once = run_once
        assert len(json.loads(response.body)["params"]) == MAX_PARAMETERS
        assert max_encoded_count[0] <= param_routes.MAX_ENCODED_AT_ONCE

    run_scenario(run_simulated, scenario)


def test_a_parameter_that_changes_its_type_is_shown_with_the_new_type(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        hostile = HostileParams(autopilot, lambda: [(b"A", 0, 1)])
        await vehicle.params.refresh()
        for param_type, expected in ((INT32, True), (REAL32, False), (200, False)):
            hostile.send_value(b"A", 0, 1, b"\1\0\0\0", param_type)
            await asyncio.sleep(0.1)
            assert vehicle.params.known("A").is_integer is expected

    run_scenario(run_simulated, scenario)
