"""Decides what each stream sends, and when: a state machine per vehicle, one scheduler for all. No I/O."""
