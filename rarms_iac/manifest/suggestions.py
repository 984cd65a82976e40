"""What somebody probably meant."""

from collections.abc import Iterable
from difflib import get_close_matches

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


def nearest(text: str, known: Iterable[str]) -> str | None:
    """The known word that is most like this one; None if none is."""
    by_folded = {word.lower().replace("-", "_"): word for word in sorted(known)}
    found = get_close_matches(text[:80].lower().replace("-", "_").replace(" ", "_"), by_folded, n=1, cutoff=0.65)
    return by_folded[found[0]] if found else None


def nearest_unit(unit: str, fitting: Iterable[str]) -> str | None:
    """The unit that was probably meant: `MB` and `mib` are MiB, `sec` is s."""
    units = tuple(fitting)
    usual = _USUAL_UNITS.get(unit.lower())
    if usual in units:
        return usual
    return next((one for one in units if one.lower() == unit.lower()), None)


def did_you_mean(suggestion: str | None) -> str:
    """The question, or nothing."""
    return f"Did you mean {suggestion}?" if suggestion else ""
