"""Flights as tests: scenarios that are flown in simulation, and what must hold in them (`gcs test`)."""
