"""Laws of contact, one folder each: `law.py`, what a scene says and what follows from it, without numba, and
`kernel.py`, what the engines compile. Laws of other packages are found by entry point (registry).
"""
