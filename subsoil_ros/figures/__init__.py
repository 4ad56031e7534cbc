"""Plots, pictures, films, HTML reports and VTK files of recorded runs."""
