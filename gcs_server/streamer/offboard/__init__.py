"""The event loop's side: what a vehicle's `offboard` offers, its configuration, status and kept limits."""
