"""Contact laws, one folder each: `law.py` has the keys of a scene and what follows from them, without numba,
and `kernel.py` the functions that the engines compile. Laws of other packages are found by entry point
(registry).
"""
