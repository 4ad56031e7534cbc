"""Following a machine that waits for nobody: its poses, and the time that the soil takes from them."""
