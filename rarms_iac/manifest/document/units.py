"""Which unit of a quantity somebody probably meant."""

from collections.abc import Iterable

_USUAL_UNITS = {
    "b": "B",
    "k": "KiB",
    "kb": "KiB",
    "kib": "KiB",
    "m": "MiB",
    "mb": "MiB",
    "mib": "MiB",
    "g": "GiB",
    "gb": "GiB",
    "gib": "GiB",
    "t": "TiB",
    "tb": "TiB",
    "tib": "TiB",
    "µs": "us",
    "μs": "us",
    "usec": "us",
    "msec": "ms",
    "millis": "ms",
    "milliseconds": "ms",
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "minute": "min",
    "minutes": "min",
    "hour": "h",
    "hours": "h",
    "percent": "%",
    "pct": "%",
    "lps": "LP",
    "cpu": "LP",
    "cpus": "LP",
    "core": "LP",
    "cores": "LP",
    "hz": "/s",
    "fps": "/s",
    "per second": "/s",
}


def nearest_unit(unit: str, fitting: Iterable[str]) -> str | None:
    """The unit that was probably meant: `MB` and `mib` are MiB, `sec` is s."""
    units = tuple(fitting)
    usual = _USUAL_UNITS.get(unit.lower())
    if usual in units:
        return usual
    return next((known for known in units if known.lower() == unit.lower()), None)
