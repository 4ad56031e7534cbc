"""Cases at the ends of every parameter; docs/extremes.md, written before, says what each must end in.

blades: closed forms of the draught of a blade (docs/wedge.md, Other theories).
"""
