"""Plots, pictures, films, HTML reports and VTK files of recorded runs."""

VIEWS = ("longitudinal", "cross", "corner", "above")
"""Views that pictures and films have. longitudinal: the bed cut along the mid-plane, seen from the right-hand
side (the paper's figure 7); cross: cut at the tip of the tool, seen from the front; corner: cut along the
mid-plane, seen from the front and above; above: all of it from above."""
