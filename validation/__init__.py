"""Cases at the ends of every parameter; validation/extremes.md, written before, says what each must end in.

blades: closed forms of the draft of a blade (validation/blades.md); wide_blade: particles
against them; narrow_blade: flat blades; materials: strength of the shipped soils.
"""
