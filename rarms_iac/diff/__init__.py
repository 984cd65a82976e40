"""Desired State x observed State -> Changes -> Steps, in an order in which the host never promises too much."""
