"""Measured drafts of blades, against runs in soil that is calibrated to its laboratory values alone."""
