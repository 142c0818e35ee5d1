"""Logs: what testing machines, balances and data loggers write while a test runs, as columns with units."""
