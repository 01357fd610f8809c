"""Decides when each stream sends what: one state machine per vehicle, one scheduler for all. No I/O."""
