"""When each stream sends, and what: one state machine a vehicle, one scheduler for all. No I/O."""
