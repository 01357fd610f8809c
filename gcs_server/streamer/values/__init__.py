"""Frozen values that the streamer's packages exchange: order, snapshot, bounds, events, outgoing."""
