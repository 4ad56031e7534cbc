"""The nodes of a run: they convert, delegate and publish."""
