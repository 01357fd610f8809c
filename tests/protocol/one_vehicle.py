"""A scripted vehicle on a link that loses packets, for the duration of a test."""

LOSS = [(0.0, 1), (0.05, 2), (0.2, 3), (0.2, 4), (0.2, 6)]
"""The share of packets lost in each direction, and the seed of the losses."""


def flight(kit, jump, scenario, *, loss=0.0, seed=0):
    """Runs a scenario with the world, the server's vehicle and its scripted autopilot."""

    async def run():
        world = kit.World()
        link = world.link()
        autopilot = world.autopilot(link, loss=loss, seed=seed)
        try:
            vehicle = await world.ready()
            await scenario(world, vehicle, autopilot)
        finally:
            await world.close()

    jump(run)
