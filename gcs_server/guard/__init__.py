"""Guarded links: programs that were written for a PX4 take this server for their vehicle
(docs/how-to-guard-a-program.md)."""
