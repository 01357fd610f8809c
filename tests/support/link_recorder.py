"""Records a link's received data, peers and states, for tests."""

import asyncio


class LinkRecorder:
    """Starts a link and records its bytes, peers and states in order."""

    def __init__(self, link):
        self.link, self.data, self.peers, self.lost_peers, self.states = link, [], [], [], []

    def start(self):
        self.link.start(self._record_data, lambda p: self.lost_peers.append(p.name), self._record_state)
        return self

    def _record_data(self, data, peer, _received_s):
        self.data.append(data)
        self.peers.append(peer)

    def _record_state(self):
        self.states.append(self.link.info().state)

    async def until(self, condition, timeout_s=20.0):
        """Polls until the condition is true.

        Raises:
            TimeoutError: the condition was not true in time.
        """
        async with asyncio.timeout(timeout_s):
            while not condition():  # noqa: ASYNC110 polls real sockets
                await asyncio.sleep(0.005)


def run_in_real_time(scenario):
    """Runs a coroutine function in a new event loop in real time."""
    asyncio.run(scenario())
