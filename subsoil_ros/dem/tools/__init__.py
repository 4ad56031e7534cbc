"""Tools in the soil: their surfaces, and the contacts on them."""
