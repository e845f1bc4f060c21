"""From a solution to a Report, the mirror of slopes.json."""
