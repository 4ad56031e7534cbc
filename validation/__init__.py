"""Cases at the limits of every parameter; validation/extremes.md, written before, has the required outcomes.

blades: closed forms of the draft of a blade (validation/blades.md); wide_blade: particles
against them; narrow_blade: flat blades; materials: strength of the shipped soils.
"""
