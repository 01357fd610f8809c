"""Measurements, not assertions: `make bench` prints the table. Ratios within one run are what counts."""
