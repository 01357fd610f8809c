"""`python -m vehicle_sim`: simulated PX4 vehicles on PX4's own ports, in real time or faster."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from vehicle_sim.options import parse
from vehicle_sim.run import run_shard
from vehicle_sim.worker_pool import process_count, run_workers, split_fleet


def main(argv: Sequence[str] | None = None) -> int:
    """Runs until the process receives a stop signal; returns 1 if no port could be opened."""
    argv = sys.argv[1:] if argv is None else argv
    arguments = parse(argv)
    shards = split_fleet(arguments.instances, arguments.processes or process_count(arguments.instances))
    return run_shard(argv, shards[0]) if len(shards) == 1 else run_workers(run_shard, argv, shards)


if __name__ == "__main__":
    raise SystemExit(main())
