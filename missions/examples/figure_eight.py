"""A figure-eight at 5 m/s, 10 m above the start: `python -m missions.examples.figure_eight`."""

from missions.examples.fly_document import main

if __name__ == "__main__":
    main("Fly a figure-eight twice at 5 m/s, and land.", "figure_eight.yaml")
