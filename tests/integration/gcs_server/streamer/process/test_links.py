"""The stream process sends signed frames on the sockets of UDP links and reports them for the recording. On
other links the server sends the setpoints."""

import asyncio
import time
from pathlib import Path
from types import SimpleNamespace

from pymavlink.dialects.v20 import common

from gcs_server.clock import SystemClock
from gcs_server.mavlink.signing import TICKS_PER_S, FrameSigner, SecretKey, SigningClock
from tests.integration.gcs_server.streamer.process.streamed_vehicle import (
    MSG_SET_POSITION_TARGET_LOCAL_NED,
    OWN_IDS,
    StreamedVehicle,
    block_event_loop,
    is_port_free,
    snapshot,
    start_stream,
    until,
    with_stream_process,
)


@with_stream_process
async def test_sent_frames_have_own_ids_and_continuous_sequence_numbers_and_are_recorded(streams, vehicle):
    await start_stream(streams, "1", vehicle)
    await until(lambda: len(vehicle.received_frames) >= 10)
    streams.end("1", "stopped", "")
    await until(lambda: len(vehicle.recorded_frames) == len(vehicle.received_frames))
    frames = [frame for _, frame in vehicle.received_frames]
    assert [raw for _, raw in vehicle.recorded_frames] == frames
    assert {(frame[5], frame[6]) for frame in frames} == {OWN_IDS}
    assert {int.from_bytes(frame[7:10], "little") for frame in frames} == {MSG_SET_POSITION_TARGET_LOCAL_NED}
    assert [frame[4] for frame in frames] == list(range(len(frames)))
    assert abs(vehicle.recorded_frames[-1][0] / 1e6 - time.clock_gettime(time.CLOCK_REALTIME)) < 5
    assert vehicle.relayed_setpoints == []


@with_stream_process
async def test_sent_frames_are_signed_and_the_key_is_not_in_the_process_arguments(streams, vehicle):
    key = bytes(range(32))
    signer = FrameSigner(SecretKey(key), 5, SigningClock(SystemClock().unix_s))
    vehicle.path.connection.signing = SimpleNamespace(signer=signer)
    await start_stream(streams, "1", vehicle)
    await until(lambda: len(vehicle.received_frames) >= 10)
    signer.clock.adopt(signer.clock.now() + 100 * TICKS_PER_S)  # the clock of a vehicle is 100 s ahead
    count = len(vehicle.received_frames)
    for _ in range(25):
        streams.update_snapshots({"1": snapshot()})
        await asyncio.sleep(0.02)
    await until(lambda: len(vehicle.received_frames) >= count + 10)
    frames = [raw for _, raw in vehicle.received_frames]
    decoder = common.MAVLink(None)
    decoder.signing.secret_key = key
    messages = [decoder.decode(bytearray(raw)) for raw in frames]
    assert all(message.get_signed() for message in messages)
    assert {message.get_link_id() for message in messages} == {5}
    first_ticks, last_ticks = (int.from_bytes(raw[-12:-6], "little") for raw in (frames[0], frames[-1]))
    assert 99 < (last_ticks - first_ticks) / TICKS_PER_S < 110
    visible_bytes = visible_to_other_users(streams.pid)
    assert b"gcs_server.streamer.process.worker" in visible_bytes
    assert key not in visible_bytes
    assert key.hex().encode() not in visible_bytes


def visible_to_other_users(pid):
    return b"".join(Path(f"/proc/{pid}/{name}").read_bytes() for name in ("cmdline", "environ"))


@with_stream_process
async def test_setpoints_for_serial_links_are_sent_while_the_loop_stalls(streams, vehicle):
    vehicle.has_datagram_socket = False
    await start_stream(streams, "1", vehicle)
    block_event_loop(0.4)
    assert len(vehicle.relayed_setpoints) >= 10
    assert {msg_id for _, msg_id, _ in vehicle.relayed_setpoints} == {MSG_SET_POSITION_TARGET_LOCAL_NED}
    assert vehicle.received_frames == []
    sent_s, created_s = vehicle.relayed_setpoints[-1][0], vehicle.created_s
    assert 0 <= sent_s - created_s < 0.5, (
        "the time of creation is not recent, so the link cannot drop late setpoints"
    )


@with_stream_process
async def test_a_new_send_path_is_used_from_the_next_update(streams, vehicle):
    await start_stream(streams, "1", vehicle)
    await until(lambda: vehicle.received_frames)
    other_vehicle = StreamedVehicle()
    vehicle.path = other_vehicle.path
    streams.update_snapshots({"1": snapshot()})
    await until(lambda: len(other_vehicle.received_frames) >= 3)
    count = len(vehicle.received_frames)
    await asyncio.sleep(0.1)
    assert len(vehicle.received_frames) == count
    vehicle.path = None
    streams.update_snapshots({"1": snapshot()})
    await until(lambda: len(vehicle.relayed_setpoints) >= 3)
    other_vehicle.close()


@with_stream_process
async def test_a_closed_links_port_is_free_after_the_process_used_its_socket(streams, vehicle):
    vehicle.link_socket.bind(("127.0.0.1", 0))
    address = vehicle.link_socket.getsockname()
    await start_stream(streams, "1", vehicle)
    await until(lambda: len(vehicle.received_frames) >= 2)
    streams.end("1", "stopped", "Test end.")
    assert streams.active() == []
    vehicle.link_socket.close()
    streams.update_snapshots({})
    await until(lambda: is_port_free(address), 1.0)
    await start_stream(streams, "2", second_vehicle := StreamedVehicle())  # the process still accepts sockets
    await until(lambda: len(second_vehicle.received_frames) >= 2)
    second_vehicle.close()


@with_stream_process
async def test_a_relay_error_loses_one_setpoint_and_the_stream_continues(streams, vehicle):
    vehicle.has_datagram_socket = False
    real_send, faults = vehicle.send_payload, []

    def send_payload(msg_id, payload, *, created_s):
        if len(faults) < 3:
            faults.append(1)
            raise TypeError("a fault of the link")
        return real_send(msg_id, payload, created_s=created_s)

    vehicle.send_payload = send_payload
    await start_stream(streams, "1", vehicle)
    await until(lambda: len(vehicle.relayed_setpoints) >= 5)


@with_stream_process
async def test_streams_to_vehicles_of_different_links_can_alternate(streams, vehicle):
    other_vehicle = StreamedVehicle()
    streams.attach("2", other_vehicle, (8, 1))
    await start_stream(streams, "1", vehicle)
    for name, receiver in (("2", other_vehicle), ("1", vehicle), ("2", other_vehicle), ("1", vehicle)):
        streams.end("1" if name == "2" else "2", "stopped", "")
        streams.take_reports()
        assert len(streams.active()) <= 1
        count, recorded = len(receiver.received_frames), len(receiver.recorded_frames)
        await start_stream(streams, name, receiver, attach=False)
        streams.update_snapshots({name: snapshot()})
        await until(lambda receiver=receiver, count=count: len(receiver.received_frames) >= count + 3)
        await until(
            lambda receiver=receiver, recorded=recorded: len(receiver.recorded_frames) >= recorded + 3
        )
    assert vehicle.relayed_setpoints == other_vehicle.relayed_setpoints == []
    other_vehicle.close()


@with_stream_process
async def test_a_closed_links_port_is_free_at_once_while_another_vehicle_is_streamed_to(streams, vehicle):
    """If the stream process kept its copy of the descriptor, the port could not be opened again."""
    other_vehicle = StreamedVehicle()
    other_vehicle.link_socket.bind(("127.0.0.1", 0))
    await start_stream(streams, "1", vehicle)
    await start_stream(streams, "2", other_vehicle)
    await until(lambda: other_vehicle.received_frames)
    address = other_vehicle.link_socket.getsockname()
    other_vehicle.link_socket.close()
    other_vehicle.path = None
    streams.links_changed()  # without update_snapshots
    await until(lambda: is_port_free(address), 1.0)
    assert streams.state("1").phase == "streaming"
    other_vehicle.close()


@with_stream_process
async def test_a_link_closed_after_its_stream_has_ended_leaves_its_port_free(streams, vehicle):
    vehicle.link_socket.bind(("127.0.0.1", 0))
    address = vehicle.link_socket.getsockname()
    await start_stream(streams, "1", vehicle)
    streams.end("1", "stopped", "")
    vehicle.link_socket.close()
    streams.links_changed()
    await until(lambda: is_port_free(address), 1.0)
