"""The number of messages waiting for one receiver is limited."""

import asyncio

import pytest

from gcs_server.errors import Disconnected
from gcs_server.mavlink.mailbox import MAX_UNREAD, Mailbox


class Frame:
    msg_id = 22


def test_waiting_messages_are_limited_and_a_lost_link_is_still_reported():
    async def run():
        mailbox = Mailbox(lambda frame: frame)
        with mailbox.expect(Frame.msg_id) as waiter:
            for _ in range(3 * MAX_UNREAD):
                mailbox.deliver(Frame())
            mailbox.fail_all(Disconnected("The link was lost."))
            for _ in range(MAX_UNREAD):
                assert isinstance(await waiter.next(), Frame)
            with pytest.raises(Disconnected):
                await waiter.next()

    asyncio.run(run())
