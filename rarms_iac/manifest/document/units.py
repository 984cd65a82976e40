"""Which unit of a quantity somebody probably meant."""

from collections.abc import Iterable

_OTHER_SPELLINGS = {
    "B": ("b",),
    "KiB": ("k", "kb", "kib"),
    "MiB": ("m", "mb", "mib"),
    "GiB": ("g", "gb", "gib"),
    "TiB": ("t", "tb", "tib"),
    "us": ("µs", "μs", "usec"),
    "ms": ("msec", "millis", "milliseconds"),
    "s": ("sec", "secs", "second", "seconds"),
    "min": ("minute", "minutes"),
    "h": ("hour", "hours"),
    "%": ("percent", "pct"),
    "LP": ("lps", "cpu", "cpus", "core", "cores"),
    "/s": ("hz", "fps", "per second"),
}


def nearest_unit(unit: str, fitting: Iterable[str]) -> str | None:
    """The unit that was probably meant: `MB` and `mib` are MiB, `sec` is s."""
    written = unit.lower()
    return next(
        (known for known in fitting if written == known.lower() or written in _OTHER_SPELLINGS.get(known, ())), None
    )
