"""One client at a time controls a vehicle: taking, requesting and forcing control, and its expiry, on a fake
clock."""

import pytest

from gcs_server.control.lease import (
    MAX_REQUESTS,
    MAX_REQUESTS_PER_ADDRESS,
    REQUEST_LIFETIME_S,
    Lease,
    LeaseTimes,
)
from gcs_server.control.principal import Principal
from gcs_server.errors import NotInControl, Refused

ANNA, BOB, CARL = (Principal.from_identity(name, name * 3) for name in ("anna", "bob", "carl"))


class Clock:
    now_s = 100.0

    def monotonic_s(self):
        return self.now_s

    def unix_s(self):
        return 1e9 + self.now_s


class LeaseSetup:
    """A control lease, the connected clients, and the published changes."""

    def __init__(self):
        self.clock, self.connected, self.answered, self.changes = Clock(), set(), set(), []
        self.lease = Lease(
            self.clock,
            "7",
            LeaseTimes(lease_s=30.0, answer_s=15.0),
            lambda client: client.key in self.connected,
            lambda client: client.key in self.answered,
            self.changes.append,
        )

    def connect(self, *clients):
        self.connected |= {client.key for client in clients}

    def disconnect(self, client):
        self.connected.discard(client.key)

    def wait(self, seconds):
        self.clock.now_s += seconds
        self.lease.expire_due()

    def actions(self):
        return [change.action for change in self.changes]


@pytest.fixture
def setup():
    return LeaseSetup()


# --- identity -------------------------------------------------------------------------------------


def test_two_tabs_with_the_same_name_are_two_clients():
    first, second = Principal.from_identity("page", "a"), Principal.from_identity("page", "b")
    assert str(first) == str(second)
    assert first.key != second.key
    assert (
        Principal.from_identity("page", "a", "10.0.0.1").key
        == Principal.from_identity("renamed", "a", "10.0.0.2").key
    )


def test_a_client_without_an_id_is_identified_by_its_name_and_address():
    assert (
        Principal.from_identity("script", "", "10.0.0.1").key
        == Principal.from_identity("script", "", "10.0.0.1").key
    )
    assert (
        Principal.from_identity("script", "", "10.0.0.1").key
        != Principal.from_identity("script", "", "10.0.0.2").key
    )
    assert (
        Principal.from_identity("script", "", "10.0.0.1").key
        != Principal.from_identity("other", "", "10.0.0.1").key
    )
    assert Principal.from_identity("", "", "10.0.0.1").name == "10.0.0.1"


def test_the_id_of_a_client_is_never_shown():
    client = Principal.from_identity("anna", "very secret")
    assert "secret" not in client.key + client.name


# --- control --------------------------------------------------------------------------------------


def test_a_command_takes_free_control_and_commands_of_other_clients_are_refused_with_a_reason(setup):
    setup.lease.admit(ANNA)
    setup.lease.admit(ANNA)
    assert setup.lease.holder.key == ANNA.key
    with pytest.raises(NotInControl, match=r"anna has control of vehicle 7, not you") as error:
        setup.lease.admit(BOB)
    assert error.value.details() == {"holder": "anna", "holder_key": ANNA.key}
    assert "Hold, Land now and Stop motors" in error.value.remedy
    assert setup.actions() == ["taken"]


def test_a_client_without_id_blocks_other_clients_only_after_taking_control_explicitly(setup):
    without_name, with_name = (
        Principal.from_identity("", "", "127.0.0.1"),
        Principal.from_identity("script", "", "127.0.0.1"),
    )
    setup.lease.admit(without_name)
    assert setup.lease.holder.name == "127.0.0.1"
    setup.lease.admit(with_name)
    assert setup.lease.holder.name == "script"
    setup.lease.admit(ANNA)
    for client in (without_name, with_name):
        with pytest.raises(NotInControl):
            setup.lease.admit(client)
    setup.lease.release(ANNA)
    setup.lease.take(without_name)
    with pytest.raises(NotInControl):
        setup.lease.admit(ANNA)
    assert setup.actions() == ["taken", "taken", "taken", "released", "taken"]


def test_control_expires_when_the_holder_sends_nothing(setup):
    setup.lease.take(ANNA, on_expiry="hold")
    setup.wait(29)
    setup.lease.renew(ANNA)
    setup.wait(29)
    assert setup.lease.holder.key == ANNA.key
    setup.lease.renew(BOB)
    setup.wait(1.1)
    assert setup.lease.holder is None
    assert setup.changes[-1].action == "expired"
    assert setup.changes[-1].on_expiry == "hold"
    setup.lease.admit(BOB)
    assert setup.lease.on_expiry == "nothing", "the action of the previous holder still applies"


def test_an_open_socket_keeps_control_and_the_lease_time_starts_when_it_closes(setup):
    setup.connect(ANNA)
    setup.lease.admit(ANNA)
    setup.wait(3600)
    assert setup.lease.holder.key == ANNA.key
    setup.disconnect(ANNA)
    setup.wait(29)
    assert setup.lease.holder is not None
    setup.wait(2)
    assert setup.lease.holder is None


def test_a_request_that_is_being_answered_keeps_control_and_the_holder_cannot_be_asked(setup):
    setup.lease.take(ANNA)
    setup.answered.add(ANNA.key)
    setup.wait(100)
    assert (setup.lease.holder, setup.lease.can_be_asked) == (ANNA, False)
    setup.answered.clear()
    setup.wait(29)
    assert setup.lease.holder == ANNA
    setup.wait(2)
    assert setup.lease.holder is None


def test_release_frees_control_and_has_no_effect_for_other_clients(setup):
    setup.lease.admit(ANNA)
    setup.lease.release(BOB)
    assert setup.lease.holder.key == ANNA.key
    setup.lease.release(ANNA)
    assert setup.lease.holder is None
    assert setup.actions() == ["taken", "released"]


# --- requests -------------------------------------------------------------------------------------


def test_a_request_is_listed_with_its_reason_and_can_be_granted(setup):
    setup.connect(ANNA, BOB)
    setup.lease.admit(ANNA)
    setup.lease.request(BOB, "I see it better")
    setup.lease.request(BOB)
    [request] = setup.lease.requests()
    assert (request.client, request.reason, request.answer_left_s) == ("bob", "I see it better", 15.0)
    with pytest.raises(NotInControl):
        setup.lease.grant(BOB, "bob")
    setup.lease.grant(ANNA, "bob")
    assert setup.lease.holder.key == BOB.key
    assert setup.changes[-1].previous.key == ANNA.key
    assert setup.lease.requests() == ()
    with pytest.raises(NotInControl):
        setup.lease.admit(ANNA)


def test_a_request_for_free_control_takes_control(setup):
    setup.lease.request(BOB)
    assert setup.lease.holder.key == BOB.key


def test_taking_control_by_force_needs_a_request_to_a_reachable_holder(setup):
    setup.connect(ANNA)
    setup.lease.admit(ANNA)
    with pytest.raises(NotInControl):
        setup.lease.take(BOB)
    with pytest.raises(Refused, match="has not been asked"):
        setup.lease.take(BOB, force=True)
    setup.lease.request(BOB)
    with pytest.raises(Refused, match="15 s left to answer"):
        setup.lease.take(BOB, force=True)
    setup.wait(15)
    setup.lease.take(BOB, force=True)
    assert setup.lease.holder.key == BOB.key
    assert setup.changes[-1].action == "forced"
    assert setup.changes[-1].text == "bob has taken control of vehicle 7 from anna by force."


def test_a_denied_client_gets_the_reason_and_may_take_control_by_force(setup):
    setup.connect(ANNA)
    setup.lease.admit(ANNA)
    setup.lease.request(BOB)
    setup.lease.deny(ANNA, BOB.key, "landing now")
    assert setup.lease.requests() == ()
    assert setup.changes[-1].reason == "landing now"
    setup.lease.take(BOB, force=True)
    assert setup.lease.holder.key == BOB.key


def test_control_of_an_unreachable_holder_may_be_taken_by_force_immediately(setup):
    setup.lease.admit(ANNA)
    setup.lease.take(BOB, force=True)
    assert setup.lease.holder.key == BOB.key


def test_a_new_holder_gets_the_full_time_to_answer_open_requests(setup):
    setup.connect(ANNA, BOB, CARL)
    setup.lease.admit(ANNA)
    setup.lease.request(BOB)
    setup.wait(14)
    setup.lease.request(CARL)
    setup.lease.grant(ANNA, "bob")
    assert [request.client for request in setup.lease.requests()] == ["carl"]
    setup.wait(14)
    with pytest.raises(Refused, match="1 s left"):
        setup.lease.take(CARL, force=True)


def test_a_denial_does_not_allow_taking_control_from_the_next_holder_by_force(setup):
    setup.connect(ANNA, CARL)
    setup.lease.admit(ANNA)
    setup.lease.request(BOB)
    setup.lease.deny(ANNA, "bob")
    setup.lease.request(CARL)
    setup.lease.grant(ANNA, "carl")
    with pytest.raises(Refused, match="has not been asked"):
        setup.lease.take(BOB, force=True)


@pytest.mark.parametrize("ending", ["released", "expired"])
def test_the_first_request_gets_control_when_the_holder_releases_or_disconnects(setup, ending):
    setup.lease.admit(ANNA)
    setup.lease.request(BOB)
    setup.lease.request(CARL)
    if ending == "released":
        setup.lease.release(ANNA)
    else:
        setup.wait(31)
    assert setup.lease.holder.key == BOB.key
    assert setup.actions()[-2:] == [ending, "taken"]
    assert [request.client for request in setup.lease.requests()] == ["carl"]


def test_requests_can_be_withdrawn_and_expire(setup):
    setup.connect(ANNA)
    setup.lease.admit(ANNA)
    setup.lease.request(BOB)
    setup.lease.release(BOB)
    assert setup.changes[-1].action == "withdrawn"
    setup.lease.request(CARL)
    setup.wait(REQUEST_LIFETIME_S + 1)
    assert setup.lease.requests() == ()


def test_the_key_distinguishes_clients_of_the_same_name(setup):
    setup.connect(ANNA)
    first, second = Principal.from_identity("page", "one"), Principal.from_identity("page", "two")
    setup.lease.admit(ANNA)
    setup.lease.request(first)
    setup.lease.request(second)
    with pytest.raises(Refused, match="2 clients named 'page'"):
        setup.lease.grant(ANNA, "page")
    with pytest.raises(Refused, match="'dora' has not requested"):
        setup.lease.grant(ANNA, "dora")
    setup.lease.grant(ANNA, second.key)
    assert setup.lease.holder.key == second.key


def test_the_holder_is_informed_when_other_clients_command_hold_or_land_now(setup):
    setup.lease.report_intervention(BOB, "Hold")
    setup.lease.admit(ANNA)
    setup.lease.report_intervention(ANNA, "Hold")
    setup.lease.report_intervention(BOB, "Land now")
    assert setup.actions() == ["taken", "intervened"]
    assert setup.changes[-1].text == "bob commanded Land now of vehicle 7; anna still has control."
    assert setup.lease.holder.key == ANNA.key


# --- limits ---------------------------------------------------------------------------------------


def test_the_number_of_open_requests_is_limited(setup):
    setup.connect(ANNA)
    setup.lease.take(ANNA)
    clients = [
        Principal.from_identity(f"c{n}", f"id {n}", f"10.0.0.{n // 10}") for n in range(MAX_REQUESTS + 1)
    ]
    for client in clients[:MAX_REQUESTS]:
        setup.lease.request(client)
    assert setup.lease.has_max_requests
    with pytest.raises(Refused, match="20 clients already request"):
        setup.lease.request(clients[MAX_REQUESTS])
    setup.lease.deny(ANNA, clients[0].key)
    setup.lease.request(clients[MAX_REQUESTS])
    assert len(setup.lease.requests()) == MAX_REQUESTS
    setup.wait(REQUEST_LIFETIME_S + 1)
    assert setup.lease.requests() == ()
    assert not setup.lease.has_max_requests


def test_one_address_cannot_use_all_requests(setup):
    setup.connect(ANNA)
    setup.lease.take(ANNA)
    for n in range(MAX_REQUESTS_PER_ADDRESS):
        setup.lease.request(Principal.from_identity("hostile", f"id {n}", "6.6.6.6"))
    for n in range(3000):
        with pytest.raises(Refused, match="at your address"):
            setup.lease.request(Principal.from_identity("hostile", f"other id {n}", "6.6.6.6"))
    assert len(setup.lease.requests()) == MAX_REQUESTS_PER_ADDRESS
    bob = Principal.from_identity("bob", "bob", "10.0.0.7")
    setup.lease.request(bob)
    assert [r.key for r in setup.lease.requests()][-1] == bob.key
