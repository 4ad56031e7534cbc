"""Following a machine that does not wait: its poses, and the time that the soil takes from them."""
