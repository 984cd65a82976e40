#!/usr/bin/env python3
"""Makes the cmdlet tables beside it out of a file of cmdlet facts (its path is the argument).

Kept: names, modules, parameter sets with what is mandatory, its position and what is taken from the pipeline, types,
accepted values, checks of values, -WhatIf, and what PowerShell 7 lacks or adds. Only what both versions have can be
used, so what 7 lacks is told.
`by-hand.json` has what the file of facts lacks, from windows-powershell-docs (docset/winserver2025-ps/FailoverClusters,
docset/winserver2019-ps/hyper-v) and PowerShell-Docs (reference/5.1); of Move-VMStorage the set that scripts use.
"""

import json
import sys
from pathlib import Path
from typing import Any

TABLES = Path(__file__).resolve().parent / "tables"


def compact(facts: dict[str, Any]) -> dict[str, Any]:
    seven = facts.get("powershell_7")
    fixed = [each for each in facts["parameters"] if not each.get("providers")]  # the others exist on some paths only
    return {
        "module": facts["module"],
        "should_process": facts["supports_should_process"],
        "default_set": facts["default_parameter_set"] or "",
        "in_7": seven is None or bool(seven["present"]),  # Hyper-V's own module serves both versions
        "not_in_7": sorted(seven.get("parameters_removed", [])) if seven else [],
        "parameters": {each["name"]: parameter(each) for each in sorted(fixed, key=lambda each: each["name"])},
    }


def parameter(facts: dict[str, Any]) -> dict[str, Any]:
    """Sets as `name: flags`; m mandatory, p0 at position 0, v by the pipeline's value, n by a property's name."""
    kept: dict[str, Any] = {"type": facts["type"].removeprefix("System.").removeprefix("Management.Automation.")}
    kept["sets"] = {name: flags(membership) for name, membership in facts["sets"].items()}
    if facts["aliases"]:
        kept["aliases"] = facts["aliases"]
    if facts.get("accepted_values"):
        kept["values"] = facts["accepted_values"]
    if checks := {name: value for name, value in facts.get("validate", {}).items() if name in ("set", "range")}:
        kept["checks"] = checks
    if facts.get("validate", {}).get("not_empty"):
        kept["not_empty"] = True
    return kept


def flags(given_in: dict[str, Any]) -> str:
    by_value = "v" if "ByValue" in given_in["pipeline"] else ""
    by_name = "n" if "ByPropertyName" in given_in["pipeline"] else ""
    position = "" if given_in["position"] is None else f"p{given_in['position']}"
    return f"{'m' if given_in['mandatory'] else ''}{position}{by_value}{by_name}"


def main() -> None:
    source = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    made = {name: compact(facts) for name, facts in source["cmdlets"].items()}
    by_hand = json.loads((TABLES / "by-hand.json").read_text(encoding="utf-8"))
    cmdlets = dict(sorted((made | by_hand).items()))
    lines = [f"{json.dumps(name)}: {json.dumps(facts, separators=(',', ':'))}" for name, facts in cmdlets.items()]
    text = "{\n" + ",\n".join(lines) + "\n}\n"  # one cmdlet a line: a difference shows what changed
    (TABLES / "cmdlets.json").write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
