"""Services, action and diagnostics of a running simulation."""
