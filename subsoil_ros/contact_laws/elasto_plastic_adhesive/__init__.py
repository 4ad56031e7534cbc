"""Spheres that yield where they touch, and stick the more the harder they were pressed."""
