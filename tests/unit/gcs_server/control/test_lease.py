"""One client at a time commands a vehicle: taking, asking, forcing, running out. On a clock of its own."""

import pytest

from gcs_server.control.lease import Lease, LeaseTimes
from gcs_server.control.principal import Principal
from gcs_server.control.requests import MAX_REQUESTS, MAX_REQUESTS_PER_ADDRESS, REQUEST_LIFETIME_S
from gcs_server.errors import NotInControl, Refused

ANNA, BOB, CARL = (Principal.of(name, name * 3) for name in ("anna", "bob", "carl"))


class Clock:
    now_s = 100.0

    def monotonic_s(self):
        return self.now_s

    def unix_s(self):
        return 1e9 + self.now_s


class Desk:
    """A lease, and everything around it."""

    def __init__(self):
        self.clock, self.there, self.told = Clock(), set(), []
        reachable = lambda client: client.key in self.there  # noqa: E731
        self.lease = Lease(
            self.clock, "7", LeaseTimes(lease_s=30.0, answer_s=15.0), reachable, self.told.append
        )

    def sits_down(self, *clients):
        self.there |= {client.key for client in clients}

    def gets_up(self, client):
        self.there.discard(client.key)

    def after(self, seconds):
        self.clock.now_s += seconds
        self.lease.expire_due()

    def actions(self):
        return [change.action for change in self.told]


@pytest.fixture
def desk():
    return Desk()


# --- who is who -----------------------------------------------------------------------------------


def test_two_tabs_with_the_same_name_are_two_clients():
    one, other = Principal.of("page", "a"), Principal.of("page", "b")
    assert str(one) == str(other)
    assert one.key != other.key
    assert Principal.of("page", "a", "10.0.0.1").key == Principal.of("renamed", "a", "10.0.0.2").key


def test_without_an_id_a_client_is_its_name_at_its_address():
    assert Principal.of("script", "", "10.0.0.1").key == Principal.of("script", "", "10.0.0.1").key
    assert Principal.of("script", "", "10.0.0.1").key != Principal.of("script", "", "10.0.0.2").key
    assert Principal.of("script", "", "10.0.0.1").key != Principal.of("other", "", "10.0.0.1").key
    assert Principal.of("", "", "10.0.0.1").name == "10.0.0.1"


def test_an_id_is_never_shown():
    client = Principal.of("anna", "very secret")
    assert "secret" not in client.key + client.name


# --- holding --------------------------------------------------------------------------------------


def test_a_command_takes_free_control_and_others_are_refused_with_a_reason(desk):
    desk.lease.command(ANNA)
    desk.lease.command(ANNA)
    assert desk.lease.holder.key == ANNA.key
    with pytest.raises(NotInControl, match=r"anna has control of vehicle 7, not you") as refused:
        desk.lease.command(BOB)
    assert refused.value.details() == {"holder": "anna", "holder_key": ANNA.key}
    assert "Hold, Land now and Kill" in refused.value.remedy
    assert desk.actions() == ["taken"]


def test_a_client_without_id_blocks_others_only_after_taking_control_explicitly(desk):
    shell, other = Principal.of("", "", "127.0.0.1"), Principal.of("script", "", "127.0.0.1")
    desk.lease.command(shell)
    assert desk.lease.holder.name == "127.0.0.1"
    desk.lease.command(other)
    assert desk.lease.holder.name == "script"
    desk.lease.command(ANNA)
    for client in (shell, other):
        with pytest.raises(NotInControl):
            desk.lease.command(client)
    desk.lease.release(ANNA)
    desk.lease.take(shell)
    with pytest.raises(NotInControl):
        desk.lease.command(ANNA)
    assert desk.actions() == ["taken", "taken", "taken", "released", "taken"]


def test_control_expires_when_the_holder_sends_nothing(desk):
    desk.lease.take(ANNA, on_expiry="hold")
    desk.after(29)
    desk.lease.renew(ANNA)
    desk.after(29)
    assert desk.lease.holder.key == ANNA.key
    desk.lease.renew(BOB)
    desk.after(1.1)
    assert desk.lease.holder is None
    assert desk.told[-1].action == "expired"
    assert desk.told[-1].on_expiry == "hold"
    desk.lease.command(BOB)
    assert desk.lease.on_expiry == "nothing", "what was agreed with another"


def test_an_open_socket_keeps_control_and_its_end_starts_the_lease_time(desk):
    desk.sits_down(ANNA)
    desk.lease.command(ANNA)
    desk.after(3600)
    assert desk.lease.holder.key == ANNA.key
    desk.gets_up(ANNA)
    desk.after(29)
    assert desk.lease.holder is not None
    desk.after(2)
    assert desk.lease.holder is None


def test_release_frees_control_and_has_no_effect_for_other_clients(desk):
    desk.lease.command(ANNA)
    desk.lease.release(BOB)
    assert desk.lease.holder.key == ANNA.key
    desk.lease.release(ANNA)
    assert desk.lease.holder is None
    assert desk.actions() == ["taken", "released"]


# --- asking ---------------------------------------------------------------------------------------


def test_a_request_is_listed_with_its_reason_and_can_be_granted(desk):
    desk.sits_down(ANNA, BOB)
    desk.lease.command(ANNA)
    desk.lease.request(BOB, "I see it better")
    desk.lease.request(BOB)
    [asked] = desk.lease.requests()
    assert (asked.client, asked.reason, asked.answer_left_s) == ("bob", "I see it better", 15.0)
    with pytest.raises(NotInControl):
        desk.lease.grant(BOB, "bob")
    desk.lease.grant(ANNA, "bob")
    assert desk.lease.holder.key == BOB.key
    assert desk.told[-1].previous.key == ANNA.key
    assert desk.lease.requests() == ()
    with pytest.raises(NotInControl):
        desk.lease.command(ANNA)


def test_requesting_free_control_takes_it(desk):
    desk.lease.request(BOB)
    assert desk.lease.holder.key == BOB.key


def test_force_needs_a_request_to_a_reachable_holder(desk):
    desk.sits_down(ANNA)
    desk.lease.command(ANNA)
    with pytest.raises(NotInControl):
        desk.lease.take(BOB)
    with pytest.raises(Refused, match="has not been asked"):
        desk.lease.take(BOB, force=True)
    desk.lease.request(BOB)
    with pytest.raises(Refused, match="15 s left to answer"):
        desk.lease.take(BOB, force=True)
    desk.after(15)
    desk.lease.take(BOB, force=True)
    assert desk.lease.holder.key == BOB.key
    assert desk.told[-1].action == "forced"
    assert desk.told[-1].text == "bob has taken control of vehicle 7 from anna by force."


def test_a_denied_client_gets_the_reason_and_may_force(desk):
    desk.sits_down(ANNA)
    desk.lease.command(ANNA)
    desk.lease.request(BOB)
    desk.lease.deny(ANNA, BOB.key, "landing now")
    assert desk.lease.requests() == ()
    assert desk.told[-1].reason == "landing now"
    desk.lease.take(BOB, force=True)
    assert desk.lease.holder.key == BOB.key


def test_control_of_an_unreachable_holder_may_be_forced_at_once(desk):
    desk.lease.command(ANNA)
    desk.lease.take(BOB, force=True)
    assert desk.lease.holder.key == BOB.key


def test_requests_wait_again_after_a_change_of_holder(desk):
    desk.sits_down(ANNA, BOB, CARL)
    desk.lease.command(ANNA)
    desk.lease.request(BOB)
    desk.after(14)
    desk.lease.request(CARL)
    desk.lease.grant(ANNA, "bob")
    assert [asked.client for asked in desk.lease.requests()] == ["carl"]
    desk.after(14)
    with pytest.raises(Refused, match="1 s left"):
        desk.lease.take(CARL, force=True)


def test_a_denial_does_not_allow_forcing_the_next_holder(desk):
    desk.sits_down(ANNA, CARL)
    desk.lease.command(ANNA)
    desk.lease.request(BOB)
    desk.lease.deny(ANNA, "bob")
    desk.lease.request(CARL)
    desk.lease.grant(ANNA, "carl")
    with pytest.raises(Refused, match="has not been asked"):
        desk.lease.take(BOB, force=True)


@pytest.mark.parametrize("ending", ["released", "expired"])
def test_the_first_request_gets_control_when_the_holder_releases_or_disconnects(desk, ending):
    desk.lease.command(ANNA)
    desk.lease.request(BOB)
    desk.lease.request(CARL)
    if ending == "released":
        desk.lease.release(ANNA)
    else:
        desk.after(31)
    assert desk.lease.holder.key == BOB.key
    assert desk.actions()[-2:] == [ending, "taken"]
    assert [asked.client for asked in desk.lease.requests()] == ["carl"]


def test_requests_can_be_withdrawn_and_expire(desk):
    desk.sits_down(ANNA)
    desk.lease.command(ANNA)
    desk.lease.request(BOB)
    desk.lease.release(BOB)
    assert desk.told[-1].action == "withdrawn"
    desk.lease.request(CARL)
    desk.after(121)
    assert desk.lease.requests() == ()


def test_the_key_distinguishes_clients_of_the_same_name(desk):
    desk.sits_down(ANNA)
    first, second = Principal.of("page", "one"), Principal.of("page", "two")
    desk.lease.command(ANNA)
    desk.lease.request(first)
    desk.lease.request(second)
    with pytest.raises(Refused, match="2 clients named 'page'"):
        desk.lease.grant(ANNA, "page")
    with pytest.raises(Refused, match="'dora' has not requested"):
        desk.lease.grant(ANNA, "dora")
    desk.lease.grant(ANNA, second.key)
    assert desk.lease.holder.key == second.key


def test_the_holder_is_informed_of_open_commands_of_others(desk):
    desk.lease.intervened(BOB, "Hold")
    desk.lease.command(ANNA)
    desk.lease.intervened(ANNA, "Hold")
    desk.lease.intervened(BOB, "Land now")
    assert desk.actions() == ["taken", "intervened"]
    assert desk.told[-1].text == "bob commanded Land now of vehicle 7; anna still has control."
    assert desk.lease.holder.key == ANNA.key


# --- bounds ---------------------------------------------------------------------------------------


def test_the_number_of_open_requests_is_limited(desk):
    desk.sits_down(ANNA)
    desk.lease.take(ANNA)
    crowd = [Principal.of(f"c{n}", f"id {n}", f"10.0.0.{n // 10}") for n in range(MAX_REQUESTS + 1)]
    for client in crowd[:MAX_REQUESTS]:
        desk.lease.request(client)
    assert desk.lease.has_max_requests
    with pytest.raises(Refused, match="20 clients already request"):
        desk.lease.request(crowd[MAX_REQUESTS])
    desk.lease.deny(ANNA, crowd[0].key)
    desk.lease.request(crowd[MAX_REQUESTS])
    assert len(desk.lease.requests()) == MAX_REQUESTS
    desk.after(REQUEST_LIFETIME_S + 1)
    assert desk.lease.requests() == ()
    assert not desk.lease.has_max_requests


def test_one_address_cannot_use_all_requests(desk):
    desk.sits_down(ANNA)
    desk.lease.take(ANNA)
    for n in range(MAX_REQUESTS_PER_ADDRESS):
        desk.lease.request(Principal.of("hostile", f"id {n}", "6.6.6.6"))
    for n in range(3000):
        with pytest.raises(Refused, match="at your address"):
            desk.lease.request(Principal.of("hostile", f"other id {n}", "6.6.6.6"))
    assert len(desk.lease.requests()) == MAX_REQUESTS_PER_ADDRESS
    bob = Principal.of("bob", "bob", "10.0.0.7")
    desk.lease.request(bob)
    assert [r.key for r in desk.lease.requests()][-1] == bob.key
