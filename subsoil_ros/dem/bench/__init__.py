"""Throughput of the soil engine. Not part of what a kernel or a bed depends on."""
