"""External modes: registration, slots, arming checks and their timeouts, executors, and replaced modes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from vehicle_sim.external_modes.arming_checks import REQUEST_EVERY_US, ArmingCheckReply
from vehicle_sim.external_modes.registry import ExternalModes, Registration, RegistrationReply
from vehicle_sim.external_modes.requirements import BUILT_IN_REQUIREMENTS
from vehicle_sim.external_modes.slots import Controllers, Overrides, name_hash

RTL, HOLD, POSITION = 5, 4, 2  # external modes have the numbers 23 to 30
CYCLE_US = 12_000
FAILED = RegistrationReply()


class Registry(ExternalModes):
    """A registry whose hashes are in a list."""

    def __init__(self, hashes: list[int] | None = None) -> None:
        self.hashes = hashes if hashes is not None else [0] * 8
        super().__init__(self.hashes, self.hashes.__setitem__)
        self.now_us = 0
        self.requests: list[int] = []

    def register_mode(self, name: str, **options: bool | int) -> RegistrationReply:
        return self.register(Registration(name, arming_check=True, mode=True, **options))  # type: ignore[arg-type]

    def run(
        self, seconds: float, reply_to: Callable[[int], ArmingCheckReply | None] = lambda _: None
    ) -> None:
        for _ in range(round(seconds * 1e6 / CYCLE_US)):
            request_id = self.update(self.now_us, failsafe_acts=False)
            if request_id is not None:
                self.requests.append(request_id)
                reply = reply_to(request_id)
                if reply is not None:
                    self.receive(reply)
            self.now_us += CYCLE_US


def reply_function(
    number: int = 0, *, can_run: bool = True, requires: str = ""
) -> Callable[[int], ArmingCheckReply]:
    return lambda request_id: ArmingCheckReply(request_id, number, can_run, frozenset(requires.split()))


def test_a_mode_gets_its_slot_by_its_name():
    registry = Registry()
    assert registry.register_mode("A") == RegistrationReply(True, 0, 23)
    assert registry.register_mode("B") == RegistrationReply(True, 1, 24)
    assert registry.unregister("A", 0, 23)
    assert registry.register_mode("C") == RegistrationReply(True, 0, 25)
    assert registry.register_mode("A") == RegistrationReply(True, 2, 23)


def test_slots_are_kept_over_a_restart():
    registry = Registry()
    for name in "ABC":
        registry.register_mode(name)
    assert Registry(registry.hashes).register_mode("C").mode == 25


def test_a_new_name_overwrites_the_first_free_slot_when_all_were_used():
    registry = Registry(hashes=[name_hash(name) for name in "ABCDEFGH"])
    assert registry.register_mode("A").mode == 23
    assert registry.register_mode("Z").mode == 24
    assert registry.hashes[1] == name_hash("Z")


def test_a_second_mode_of_the_same_name_stores_no_hash():
    registry = Registry()
    assert [registry.register_mode("A").mode for _ in range(2)] == [23, 24]
    assert registry.hashes[1] == 0


def test_at_most_eight_modes_and_five_executors_are_registered():
    registry = Registry()
    executors = [registry.register_mode(f"E{n}", executor=True).executor for n in range(5)]
    assert executors == [1, 2, 3, 4, 5]
    assert registry.register_mode("E5", executor=True) == FAILED
    assert [registry.register_mode(f"M{n}").mode for n in range(3)] == [28, 29, 30]
    assert registry.register_mode("M3") == FAILED


@pytest.mark.parametrize(
    "registration",
    [Registration("A", mode=True), Registration("A", arming_check=True, executor=True)],
    ids=["a mode without an arming check", "an executor without a mode"],
)
def test_an_incomplete_registration_fails(registration):
    assert Registry().register(registration) == FAILED


def test_a_registration_without_mode_check_and_executor_succeeds():
    assert Registry().register(Registration("A")) == RegistrationReply(True)


def test_a_mode_with_another_name_is_not_removed():
    registry = Registry()
    registry.register_mode("A")
    assert not registry.unregister("B", 0, 23)
    assert registry.mode(23) is not None


def test_requests_are_sent_every_312_ms_while_a_component_is_registered():
    registry = Registry()
    registry.run(1.0)
    assert registry.requests == []
    registry.register_mode("A")
    registry.run(REQUEST_EVERY_US * 10 / 1e6 - 0.01, reply_function())
    assert registry.requests == list(range(1, 11))


def test_a_component_that_never_replies_is_unresponsive_after_eleven_requests():
    registry = Registry()
    registry.register_mode("A")
    registry.run(3.15)
    assert not registry.health().unresponsive
    registry.run(0.1)
    assert registry.health().unresponsive == 1 << 23


def test_a_component_that_stops_replying_is_unresponsive_after_four_requests():
    registry = Registry()
    registry.register_mode("A")
    registry.run(1.0, reply_function())
    registry.run(1.2)
    assert not registry.health().unresponsive
    registry.run(0.3)
    assert registry.health().unresponsive == 1 << 23
    registry.run(0.4, reply_function())
    assert not registry.health().unresponsive


def test_a_component_that_was_unresponsive_four_times_stays_unresponsive():
    registry = Registry()
    registry.register_mode("A")
    for _ in range(3):
        registry.run(1.0, reply_function())
        registry.run(2.0)
    registry.run(1.0, reply_function())
    assert not registry.health().unresponsive
    registry.run(2.0)
    registry.run(1.0, reply_function())
    assert registry.health().unresponsive


def test_a_reply_to_an_older_request_does_not_count():
    registry = Registry()
    registry.register_mode("A")
    registry.run(3.5, lambda request_id: ArmingCheckReply(request_id - 1, 0, True))
    assert registry.health().unresponsive


def test_a_check_without_a_mode_is_removed_when_its_component_is_unresponsive():
    registry = Registry()
    registry.register(Registration("A", arming_check=True))
    registry.run(1.0)
    assert registry.health().not_armable == 0xFFFFFFFF
    registry.run(2.5)
    assert registry.health().not_armable == 0


def test_before_its_first_reply_a_component_counts_as_the_last_reply_in_its_slot_says():
    registry = Registry()
    check = Registration("A", arming_check=True)
    registry.register(check)
    registry.run(0.5, reply_function())
    registry.unregister("A", 0, -1)
    registry.register(check)
    registry.run(0.012)
    assert registry.health().not_armable == 0, "the slot still has a reply that the vehicle can arm"
    registry.register(Registration("B", arming_check=True))
    assert registry.health().not_armable == 0xFFFFFFFF, "zeros in a new slot count for registration 0"


def test_a_second_component_that_has_not_replied_counts_for_the_first_registration():
    registry = Registry()
    registry.register_mode("M")
    registry.run(0.5, reply_function())
    registry.register(Registration("A", arming_check=True))
    registry.run(0.012)
    assert registry.health().not_armable == 1 << 23


def test_only_the_last_four_simultaneous_replies_count():
    registry = Registry()
    for n in range(5):
        registry.register_mode(f"M{n}")
    for n in range(5):
        registry.receive(ArmingCheckReply(0, n, True))
    registry.run(0.012)
    assert registry.health().not_armable == 1 << 23


def test_requirements_of_a_mode_also_apply_to_the_mode_that_it_replaces():
    registry = Registry()
    registry.register_mode("A", replaces=RTL)
    registry.run(0.1, reply_function(requires="local_position"))
    requirements = registry.health().requirements
    assert requirements.local_position == BUILT_IN_REQUIREMENTS.local_position | 1 << 23 | 1 << RTL
    assert requirements.home_position == BUILT_IN_REQUIREMENTS.home_position & ~(1 << RTL)
    assert not requirements.other >> 23 & 1


def test_a_mode_that_cannot_run_prevents_arming_only_in_this_mode():
    registry = Registry()
    registry.register_mode("A")
    registry.run(0.1, reply_function(can_run=False))
    assert registry.health().not_armable == 1 << 23
    assert registry.health().requirements == BUILT_IN_REQUIREMENTS


def test_an_unresponsive_mode_is_removed_unless_it_is_selected():
    registry = Registry()
    registry.register_mode("A")
    registry.run(3.5)
    registry.remove_unresponsive(23)
    assert registry.mode(23) is not None
    registry.remove_unresponsive(HOLD)
    assert registry.mode(23) is None


def test_a_replacement_is_flown_while_its_component_replies():
    registry = Registry()
    registry.register_mode("My RTL", replaces=RTL)
    assert registry.register_mode("Other RTL", replaces=RTL) == FAILED
    assert registry.effective_mode(RTL) == 23
    assert registry.replaced_mode(23) == RTL
    assert registry.settable(0xFF) == 0xFF & ~(1 << RTL) | 1 << 23
    registry.run(3.5)
    assert registry.effective_mode(RTL) == RTL


def test_the_executor_of_the_selected_mode_is_in_charge():
    registry = Registry()
    registry.register_mode("A", executor=True)
    registry.on_mode_change(23)
    assert registry.executor_in_charge == 1
    registry.commanded_by_executor = True
    registry.on_mode_change(HOLD)
    assert registry.executor_in_charge == 1
    registry.commanded_by_executor = False
    registry.on_mode_change(HOLD)
    assert registry.executor_in_charge == 0


def test_no_executor_is_in_charge_during_a_failsafe():
    registry = Registry()
    registry.register_mode("A", executor=True)
    registry.on_mode_change(23)
    registry.update(0, failsafe_acts=True)
    assert registry.executor_in_charge == 0
    registry.update(0, failsafe_acts=False)
    assert registry.executor_in_charge == 1


def test_an_unregistered_executor_is_not_in_charge():
    registry = Registry()
    registry.register_mode("A", executor=True)
    registry.on_mode_change(23)
    registry.unregister("A", 0, 23)
    assert registry.executor_in_charge == 0


def test_overrides_of_the_mode_and_of_the_executor_in_charge_apply():
    registry = Registry()
    registry.register_mode("A", executor=True)
    registry.set_overrides(Overrides(disable_auto_disarm=True), mode=23)
    registry.set_overrides(Overrides(defer_failsafes=True, defer_timeout_s=4), executor=1)
    assert registry.overrides(23) == Overrides(disable_auto_disarm=True)
    registry.on_mode_change(23)
    assert registry.overrides(23) == Overrides(True, True, 4)
    assert registry.overrides(HOLD) == Overrides(False, True, 4)


def test_a_mode_without_configuration_has_no_controllers():
    registry = Registry()
    registry.register_mode("A")
    assert registry.controllers(23) == Controllers()
    registry.set_controllers(23, Controllers(velocity=True))
    assert registry.controllers(23).trajectory


def test_registrations_and_published_changes_are_counted():
    registry = Registry()
    received_seqs: list[int] = []
    registry.on_mode_list_change = lambda: received_seqs.append(registry.mode_list_seq)
    registry.on_status_published(registry.settable(0))
    registry.register_mode("A")
    registry.on_status_published(registry.settable(0))
    registry.on_status_published(registry.settable(0))
    assert received_seqs == [1, 2]


def test_disarming_selects_the_mode_of_the_executor_in_charge_and_hold_for_one_that_does_not_answer():
    registry = Registry()
    mode, without_executor = (
        registry.register_mode("Mine", executor=True).mode,
        registry.register_mode("A").mode,
    )
    assert registry.mode_after_disarming(POSITION) == POSITION
    assert registry.mode_after_disarming(without_executor) == without_executor
    registry.on_mode_change(mode)
    assert registry.mode_after_disarming(POSITION) == mode
    registry.run(5.0)
    assert registry.mode_after_disarming(POSITION) == HOLD
    registry.failsafe_acts = True
    assert registry.mode_after_disarming(POSITION) == POSITION
    assert registry.mode_after_disarming(without_executor) == HOLD
