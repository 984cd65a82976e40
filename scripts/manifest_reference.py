"""The manifest's reference as Markdown, made from what the document says of itself (`docs/manifest.md`)."""

import re
from collections.abc import Iterator
from textwrap import dedent
from typing import Any

from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.model.names import NAME_PATTERN, TASK_PATTERN

Schema = dict[str, Any]

_INTRODUCTION = """\
# The manifest

`rarms.yaml` describes the components of an application, their thresholds and their hosts. This page is generated from
the description of the format in rarms. `rarms schema` prints the same description for editors. `manifests/` has
complete examples, and `rarms init` writes a first manifest.

- Keys are snake_case. Names are keys of maps, never items of lists.
- Names have 1 to 63 small letters, digits and hyphens, and start and end with a letter or digit.
- Quantities have a unit: time `us`, `ms`, `s`, `min`, `h`; memory `B`, `KiB`, `MiB`, `GiB`, `TiB`; shares `%`;
  processors `LP`; rates `/s`, `/min`, `/h`. A quantity without a unit is an error.
- The file is YAML 1.2 without aliases, merge keys, tags and further documents. `no` is a text.
- An overlay (`--overlay FILE`) has only the different keys. Maps are merged, all other values are replaced, and `null`
  removes a key. The overlay replaces `apt.<index>`, `run.samples` and `run.until` as a whole. A component, host or
  partition that is only in the overlay needs `new: true`. Without `new: true`, rarms treats its name as misspelt.
- `rarms fmt` writes a manifest in the canonical form.
"""

_EXAMPLES = {
    "System": """\
        schema: rarms/v1
        application: { name: delivery-robot }

        hosts:
          onboard: { logical_processors: 2, memory: 4 GiB }

        components:
          face-detection: { criticality: 40, cpu: { reserve: 40 % } }
        """,
    "Application": "application: { name: delivery-robot, description: Brings parcels. }",
    "Host": """\
        hosts:
          onboard:
            provider: simulated
            platform: two-core-onboard
            logical_processors: 2
            memory: 4 GiB
            keep_for_host: { processor: 10 %, memory: 1 GiB }
        """,
    "SimulatedHost": """\
        simulated:
          scheduler: root
          faults:
            full-disk: { operation: create_partition, effect: fail_after, times: 1 }
        """,
    "HypervHost": r"hyperv: { generation: 2, switch: cell, image: D:\images\base.vhdx, vm_path: D:\machines }",
    "LinuxHost": "linux: { slice: robot, control_groups: v2 }",
    "Connect": "connect: { ssh: rarms@cell-4, shell: pwsh }",
    "Component": """\
        components:
          face-detection:
            criticality: 40
            apt:
              mean_response_time: { at_most: 100 ms }
            run:
              command: [python3, components/face_detection.py]
              samples: { from: json_lines, response_time: { field: response, unit: ms } }
            memory: 512 MiB
            task: ObjectIdentification
            cpu: { reserve: 40 % }
            apart: [video-streaming]
        """,
    "apt": """\
        apt:
          p95_response_time: { at_most: 400 ms }
          success_rate: { at_least: 95 % }
        """,
    "Run": """\
        run:
          command: [python3, components/video_streaming.py]
          environment: { CAMERA: front, TOKEN: { from_env: CAMERA_TOKEN } }
          arrival: { every: 33 ms }
          until: { elapsed: 20 s }
          samples: { from: json_lines, count: { field: frames } }
        """,
    "Samples": """\
        samples:
          from: pattern
          pattern: '^heard .* ok=(?P<ok>[01]) ms=(?P<ms>\\S+)'
          response_time: { field: ms, unit: ms }
          success: { field: ok }
        """,
    "CpuRequest": "cpu: { reserve: 20 %, limit: 60 %, weight: 200 }",
    "Simulation": "simulation: { work: 61.6 ms, blocked: 26.4 ms, varies: 5 % }",
    "PartitionRequest": """\
        partitions:
          voice: { components: [voice, wayfinding], memory: 2 GiB, cpu: { reserve: 35 % } }
          payment: { protect: true }
        """,
    "Guest": "guest: { connect: { ssh: operator@voice }, credential: kiosk/voice }",
    "BusyLoop": "interference:\n  busy-loop: { kind: busy_loop, threads: 2 }",
    "Bursts": "interference:\n  frames: { kind: bursts, every: 40 ms, duty: 30 % }",
    "Stress": "interference:\n  disk: { kind: stress, stressor: hdd, workers: 2 }",
    "Browser": "interference:\n  browsers: { kind: browser, instances: 5 }",
    "CommandLoad": "interference:\n  recorder: { kind: command, command: [rosbag, record, --all], instances: 2 }",
    "TaskRequest": "tasks:\n  MotionControl: { category: Medium, priority: 6 }",
    "Policy": "policy: { minimise: reservation, max_disruption: partition_stop }",
    "MeasuringLimits": "measuring: { setting: 5 min, proof: 20 min }",
    "Acceptance": """\
        accept:
          RARMS041: { at: [partition/vision], reason: The driver needs it., until: 2027-01-31 }
        """,
}


def reference_markdown() -> str:
    """Return the whole page: one section a block, in the order in which a reader meets them."""
    document = manifest_schema()
    sections = [_section("The document", "System", document, document)]
    for path, name in _blocks("", document, document, {"System"}):
        schema = document["$defs"][name] if name in document["$defs"] else _thresholds(document)
        sections.append(_section(f"`{path}`", name, schema, document))
    return "\n".join([_INTRODUCTION, *sections])


def _thresholds(document: Schema) -> Schema:
    found: Schema = document["$defs"]["Component"]["properties"]["apt"]
    return found


def _blocks(path: str, schema: Schema, document: Schema, seen: set[str]) -> Iterator[tuple[str, str]]:
    """Path and name of every block once, where it is met first."""
    for key, value in schema["properties"].items():
        for step, name in _referred(value, document):
            if name not in seen:
                seen.add(name)
                there = f"{path}.{key}{step}".lstrip(".")
                yield there, name
                yield from _blocks(there, document["$defs"].get(name, {"properties": {}}), document, seen)


def _referred(value: Schema, document: Schema) -> Iterator[tuple[str, str]]:
    """Yield the blocks that a value may be, with the step to them: a map's are below any name."""
    if "patternProperties" in value:
        yield "", "apt"
    for alternative in [value, *value.get("oneOf", ()), *value.get("anyOf", ())]:
        name = alternative.get("$ref", "").removeprefix("#/$defs/")
        if name and "properties" in document["$defs"][name]:
            yield "", name
    if isinstance(below := value.get("additionalProperties"), dict):
        yield from ((f".NAME{step}", name) for step, name in _referred(below, document))


def _section(title: str, name: str, schema: Schema, document: Schema) -> str:
    lines = [f'<a id="{_anchor(name)}"></a>', f"## {title}", "", schema.get("description", ""), ""]
    lines += ["| key | value | default | |", "|---|---|---|---|"]
    fields = {**schema["properties"], **_pattern_fields(schema)}
    needed = schema.get("required", ())
    for key, value in fields.items():
        default = "needed" if key in needed else _default(value)
        lines.append(f"| `{key}` | {_kind(value, document)} | {default} | {_cell(_description(value, document))} |")
    if rule := _rule(schema):
        lines += ["", rule]
    lines += ["", "```yaml", *_example(name), "```", ""] if name in _EXAMPLES else [""]
    return "\n".join(lines)


def _pattern_fields(schema: Schema) -> Schema:
    """Fields whose key is a pattern, under a key that is an example of it."""
    fields: Schema = schema.get("patternProperties", {})
    return {"p95_response_time" if pattern.startswith("^p") else pattern: value for pattern, value in fields.items()}


def _rule(schema: Schema) -> str:
    alternatives = [f"`{key}`" for choice in schema.get("oneOf", ()) for key in choice.get("required", ())]
    return f"Exactly one of {' and '.join(alternatives)}." if alternatives else ""


def _default(value: Schema) -> str:
    if "default" not in value:
        return "absent"
    default = value["default"]
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f"`{default}`" if default != "" else "empty"


def _description(value: Schema, document: Schema) -> str:
    referred = document["$defs"].get(value.get("$ref", "").removeprefix("#/$defs/"), {})
    description: str = value.get("description") or referred.get("description", "")
    return description


def _kind(value: Schema, document: Schema) -> str:
    """Return the form of a value, in a few words."""
    if "$ref" in value:
        name = value["$ref"].removeprefix("#/$defs/")
        schema = document["$defs"][name]
        return f"[map](#{_anchor(name)})" if "properties" in schema else _kind(schema, document)
    for several in ("oneOf", "anyOf"):
        if several in value:
            return ", ".join(dict.fromkeys(_kind(choice, document) for choice in value[several]))
    if "const" in value:
        return _cell(f"`{value['const']}`")
    if "enum" in value:
        return ", ".join(f"`{choice}`" for choice in value["enum"])
    if "examples" in value:
        return f"quantity like {' or '.join(f'`{example}`' for example in value['examples'])}"
    if "patternProperties" in value:
        return "[map](#apt) by index"
    match value.get("type"):
        case "object" if isinstance(value.get("additionalProperties"), dict):
            return f"map by name: {_kind(value['additionalProperties'], document)}"
        case "object":
            return "map of " + ", ".join(
                f"`{key}`: {_kind(inner, document)}" for key, inner in value["properties"].items()
            )
        case "array":
            return f"list of: {_kind(value['items'], document)}"
        case "integer":
            return f"number{_range(value)}"
        case "boolean":
            return "`true`, `false`"
        case _:
            return _text_kind(value.get("pattern", ""))


def _text_kind(pattern: str) -> str:
    known = {NAME_PATTERN: "name", TASK_PATTERN: "task class"}
    return next((word for start, word in known.items() if pattern.startswith(start)), "text")


def _range(value: Schema) -> str:
    low, high = value.get("minimum"), value.get("maximum")
    return f", {low} to {high}" if low is not None and high is not None else ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _anchor(name: str) -> str:
    """`HypervHost` -> `hyperv-host`."""
    words = re.findall("[A-Z]?[a-z]+", name)
    return "-".join(words).lower()


def _example(name: str) -> list[str]:
    return dedent(_EXAMPLES[name]).rstrip("\n").split("\n")


def examples() -> dict[str, str]:
    """Return the examples of the page, by the block that they show."""
    return {name: "\n".join([*_example(name), ""]) for name in _EXAMPLES}
