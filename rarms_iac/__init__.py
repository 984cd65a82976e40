"""rarms: CPU reservations for components that must answer in time, from a manifest to an applied plan."""

__version__ = "0.1.0"
