"""Names of the views that pictures and films have; renderer.py draws them."""

VIEWS = ("longitudinal", "cross", "corner", "above")
"""longitudinal: the bed cut along the mid-plane, seen from the right-hand side (the paper's figure 7); cross:
cut at the tip of the tool, seen from the front; corner: cut along the mid-plane, seen from the front and
above; above: all of it from above."""
