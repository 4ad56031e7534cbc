"""What others may ask of a running simulation, and how it says how it does."""
