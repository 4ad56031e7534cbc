"""Beds: how the soil is put into the bin before a run."""
