"""Cases at the ends of every parameter; docs/extremes.md, written before, says what each must end in."""
