"""The frozen values that the rooms hand to each other: order, snapshot, bounds, events, outgoing."""
