"""Load, check, run and read: the one wiring of engines, recorder and loop."""
