"""Frozen values that the streamer's packages exchange: request, snapshot, bounds, events, outgoing."""
