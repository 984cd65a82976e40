"""The order of the keys of a manifest, and which values are quantities.

Maps that the user names (hosts, components, ...) keep the user's order.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class ValueShape:
    """What the formatter knows of a value: its known keys in order, or what stands under any name."""

    keys: Mapping[str, "ValueShape"] = field(default_factory=dict)
    each: "ValueShape | None" = None  # the shape of every value of a map that the user names
    is_quantity: bool = False

    def of(self, key: str) -> "ValueShape":
        """The shape of the value under this key."""
        return self.keys.get(key) or self.each or VALUE


VALUE = ValueShape()
QUANTITY = ValueShape(is_quantity=True)


def _map(known: str = "", /, **shaped: ValueShape) -> ValueShape:
    """The keys in the order of `known`; those that are not in `shaped` are plain values."""
    return ValueShape({key: shaped.get(key, VALUE) for key in known.split()})


def _quantities(known: str) -> ValueShape:
    return ValueShape(dict.fromkeys(known.split(), QUANTITY))


def _named(each: ValueShape) -> ValueShape:
    return ValueShape(each=each)


_CONNECT = _map("ssh shell")
_CPU = _map("reserve limit weight", reserve=QUANTITY, limit=QUANTITY)

_HOST = _map(
    "provider platform connect logical_processors memory keep_for_host system_responsiveness simulated hyperv linux",
    connect=_CONNECT,
    memory=QUANTITY,
    keep_for_host=_quantities("processor memory"),
    simulated=_map(
        "windows_build guest_windows_build client scheduler smt administrator faults",
        faults=_named(_map("operation at effect delay times", delay=QUANTITY)),
    ),
    hyperv=_map("generation switch image vm_path secure_boot credential"),
    linux=_map("slice control_groups mechanism"),
)

_RUN = _map(
    "command call folder files environment arrival deadline until timeout failures stop samples",
    environment=_named(_map("from_env")),
    arrival=_quantities("every"),
    deadline=QUANTITY,
    until=_map("samples elapsed", elapsed=QUANTITY),
    timeout=QUANTITY,
    stop=_map("signal grace", grace=QUANTITY),
    samples=_map(
        "from pattern response_time success count",
        response_time=_map("field unit"),
        success=_map("field"),
        count=_map("field"),
    ),
)

_COMPONENT = _map(
    "criticality apt run interference memory processors task cpu together apart dedicated hosts runs_on simulation",
    apt=_named(_quantities("at_most at_least")),
    run=_RUN,
    memory=QUANTITY,
    cpu=_CPU,
    simulation=_map(
        "work blocked varies threads success_within",
        work=QUANTITY,
        blocked=QUANTITY,
        varies=QUANTITY,
        success_within=QUANTITY,
    ),
)

_PARTITION = _map(
    "components processors memory cpu protect start stop hyperv linux guest",
    memory=QUANTITY,
    cpu=_CPU,
    stop=_quantities("grace"),
    hyperv=_map("generation switch image vm_path secure_boot"),
    linux=_map("mechanism"),
    guest=_map("connect credential windows_build", connect=_CONNECT),
)

MANIFEST = _map(
    "schema application hosts components partitions interference tasks policy moved",
    application=_map("name description requires_rarms"),
    hosts=_named(_HOST),
    components=_named(_COMPONENT),
    partitions=_named(_PARTITION),
    interference=_named(_map("kind command stressor threads workers instances")),
    tasks=_named(_map("category priority background_priority replace_shipped")),
    policy=_map(
        "interference minimise headroom max_disruption accept",
        accept=_named(_map("at reason until")),
    ),
    moved=_named(VALUE),
)
"""The whole manifest; an overlay has the same shape."""
