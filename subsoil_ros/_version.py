"""The version of the package, apart from the names it offers: every module may import it."""

__version__ = "0.2.0"
