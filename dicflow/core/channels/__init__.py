"""Channels of machines beside the cameras: joined to steps by their clocks, their rates, and phases of the load.

A log is a set of rows with times; a step has one time. Times are in seconds, and ``offset`` is what the log's clock
shows more than that of the steps.
"""
