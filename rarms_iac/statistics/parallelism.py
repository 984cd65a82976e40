"""How many processors a component can use at once, as its consumed CPU time shows."""

from collections.abc import Iterable
from math import ceil

from rarms_iac.model.measurement import Series, Setting
from rarms_iac.statistics.samples import response_times

_MORE = 0.1  # processors by which consumed CPU time may exceed a whole number, and still count as that
_BUSY = 0.9  # a part of these processors: so much is consumed where nothing but their number holds the component back


def usable_processors(settings: Iterable[Setting], component: str, processors: int) -> int | None:
    """Say on how few processors a component would do as well, since it never uses more of them.

    A CR of 40 % is 40 % of each virtual processor. While it had a job, the component consumed at no setting more than
    so many processors' shares, and at one nearly all of these: neither the rest of its reserve nor what it waits for
    held it back, but its threads. A component that is busy on more of them for a short while only may still be slower:
    measure it again.

    Args:
        settings: the component's, measured alone, in any order.
        component: its name.
        processors: of its partition; a CR is per cent of these.

    Returns:
        Fewer than `processors`; None: nothing shows that fewer are enough.
    """
    used = [
        share * 100 / setting.reserve
        for setting in settings
        for series in setting.series
        if series.component == component and (share := _consumed(series)) is not None
    ]
    most = max(used, default=float(processors))
    usable = max(1, ceil(most - _MORE))
    return usable if usable < processors and most >= _BUSY * usable else None


def _consumed(series: Series) -> float | None:
    """Logical processors in use on average while there was a job."""
    busy_ms = sum(response_times(series.samples))
    return series.cpu_ms / busy_ms if series.cpu_ms and busy_ms else None
