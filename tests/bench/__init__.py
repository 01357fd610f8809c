"""Measurements without assertions: `make bench` prints the tables. Compare only ratios within one run."""
