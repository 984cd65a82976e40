"""A manifest of many components, as large users have them: about 13 lines a component."""


def manifest(components: int) -> str:
    """Its text; every component differs in name and numbers, and all of them fit."""
    hosts = max(1, components // 20)
    lines = ["schema: rarms/v1", "", "application:", "  name: fleet", "", "hosts:"]
    for number in range(hosts):
        lines += [f"  cell-{number:04}:", "    provider: simulated", "    platform: cell"]
        lines += ["    logical_processors: 8", "    memory: 32 GiB"]
    lines += ["", "components:"]
    for number in range(components):
        lines += _component(number)
    return "\n".join(lines) + "\n"


def _component(number: int) -> list[str]:
    return [
        f"  component-{number:04}:            # number {number} of the line",
        f"    criticality: {1 + number % 97}",
        "    apt:",
        f"      mean_response_time: {{ at_most: {50 + number % 50} ms }}",
        "    run:",
        f"      command: [python3, components/c{number:04}.py]",
        "      until: { samples: 200 }",
        "      samples: { from: json_lines, response_time: { field: response, unit: ms } }",
        f"    memory: {256 + number % 4 * 64} MiB",
        "    cpu:",
        f"      reserve: {1 + number % 5} %",
        "      weight: 100",
        "    processors: 2",
    ]
