"""The report as one HTML file: no network, nothing next to it, and a policy that lets nothing else in.

The content security policy names the digests of the page's own style and script; everything else is refused by the
browser, so that no text of a manifest or a log can become code even if escaping failed.
"""

import json
from base64 import b64encode
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from hashlib import sha256
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import PlatformCapacity, Report
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.quantities import guaranteed
from rarms_iac.statistics.distributions import ERRORS_EXPLAINED
from rarms_iac.storage.shipped import shipped, shipped_text
from rarms_iac.texts.quantities import show_processors
from rarms_iac.views.console import command_text, plain_text, visible
from rarms_iac.views.findings_text import excerpt_text
from rarms_iac.views.graph import drawing_of
from rarms_iac.views.reports.page import RESERVES, Card, cards_of, data_of
from rarms_iac.views.reports.tables import (
    candidates_left_out,
    levels_table,
    proofs_table,
    ranked_candidates,
    trail_table,
    tuned_table,
)
from rarms_iac.views.status import applied_text, fit_text
from rarms_iac.views.table import show_cell
from rarms_iac.views.tune import tuning_text
from rarms_iac.views.verdicts import advise_to_measure

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

FOLDER = "templates/report"
MODULES = ("lookup.js", "axis.js", "show.js", "move.js", "report.js")
"""The page's ES modules, each after those that it imports: one script, in this order, without a server."""


def as_html(report: Report, manifest_options: str = "") -> bytes:
    """Return the whole page in UTF-8 with LF; the same report gives the same bytes.

    Args:
        manifest_options: what commands end with, such as ` -f cell`.
    """
    from markupsafe import Markup

    style = _read("report.css") + _line_rules(cards_of(report))
    script = joined_modules(MODULES)
    return render_page(
        report,
        findings=report.findings,
        sources={},
        manifest_options=manifest_options,
        style=Markup(style),  # noqa: S704 - ours, to the byte
        script=Markup(script),  # noqa: S704 - ours, to the byte
        policy=_policy(style, script),
        studio=None,
    )


def render_page(
    report: Report, *, findings: Sequence[Diagnostic], sources: Sources, manifest_options: str, **context: object
) -> bytes:
    """Return the page of a report, with or without a server: what both show is filled in here.

    Args:
        report: what was measured; it may be empty.
        findings: what else is to be said.
        sources: that the findings point into; the lines of what they lack are not shown.
        manifest_options: what commands end with, such as ` -f cell`.
        context: how scripts and style come into the page, and what a server adds.
    """
    from markupsafe import Markup

    cards = cards_of(report)
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            application=report.application,
            description=report.description,
            cards=cards,
            levels=levels_table(report).on_page(),
            bars=[_bar(fit) for fit in report.capacities],
            proofs=proofs_table(report).on_page(),
            tunings=[
                (tuning.platform, tuning_text(tuning), trail_table([tuning]).on_page(), tuned_table(tuning).on_page())
                for tuning in report.tunings
            ],
            candidates=ranked_candidates(report).on_page(),
            drawing=drawing_of(report),
            show_cell=show_cell,
            more_candidates=candidates_left_out(report),
            statuses=[
                (
                    bool(host.to_apply),
                    host.name,
                    plain_text(applied_text(host, is_planned=report.is_planned), manifest_options),
                )
                for host in report.hosts
            ],
            missing=plain_text(advise_to_measure(report.verdicts) or "", manifest_options),
            findings=[_finding(diagnostic, sources, manifest_options) for diagnostic in findings],
            reserves=RESERVES,
            words=command_text,
            manifest_options=manifest_options,
            lp=lambda reserve, processors: show_processors(guaranteed(reserve, processors)),
            errors=ERRORS_EXPLAINED,
            data=Markup(_script_json({**data_of(report, cards), "manifest_options": manifest_options})),  # noqa: S704 - no sign that HTML reads is left in it
            **context,
        )
    )
    return text.encode("utf-8", "replace")


def joined_modules(names: Sequence[str]) -> str:
    """Return the modules as one script: what one of them exports, those after it see without an import.

    Args:
        names: of the files, each after those that it imports.
    """
    lines = [line for name in names for line in _read(name).splitlines()]
    own = (line.removeprefix("export ") for line in lines if not line.startswith("import "))
    return "\n".join(('"use strict";', "(() => {", *own, "})();", ""))


def _bar(fit: PlatformCapacity) -> dict[str, str]:
    """Return the reserved part in per cent of the processors."""
    processors = fit.processors
    return {
        "platform": fit.platform,
        "hosts": ", ".join(fit.hosts),
        "fit": fit_text(fit),
        "room": f"{float(100 * fit.capacity_lp / processors):.3f}",
        "used": f"{float(min(100 * fit.reserved_lp / processors, Fraction(100))):.3f}",
        "kind": "used" if fit.fits else "used over",
    }


def _finding(diagnostic: Diagnostic, sources: Sources, manifest_options: str) -> dict[str, object]:
    return {
        "kind": f"{diagnostic.severity}[{diagnostic.code}]",
        "summary": diagnostic.summary,
        "detail": diagnostic.detail,
        "advice": plain_text(diagnostic.advice, manifest_options),
        "excerpt": excerpt_text(diagnostic, sources),
        "where": str(diagnostic.place or diagnostic.address),
        "values": {
            name: ", ".join(value) if isinstance(value, tuple) else str(value)
            for name, value in diagnostic.values.items()
        },
        "commands": list(diagnostic.commands),
        "levels": _relaxed_levels(diagnostic),
    }


def _relaxed_levels(diagnostic: Diagnostic) -> list[list[dict[str, str]]]:
    """Return the levels that each of its ways out chooses, together where there are several."""
    names = ("ways", "components", "indexes", "levels")
    rows = [diagnostic.values.get(f"relaxed_{name}", ()) for name in names]
    ways: dict[str, list[dict[str, str]]] = {}
    for way, component, index, level in zip(*(row for row in rows if isinstance(row, tuple)), strict=True):
        ways.setdefault(way, []).append({"component": component, "index": index, "level": level})
    return list(ways.values())


def _policy(style: str, script: str) -> str:
    return (
        f"default-src 'none'; style-src {_digest(style)}; script-src {_digest(script)}; "
        "base-uri 'none'; form-action 'none'"
    )


def _digest(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"


def _script_json(data: object) -> str:
    """Write JSON that cannot end an element: each character that HTML reads is an escape."""
    text = json.dumps(_visible_in(data), separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _visible_in(data: object) -> object:
    """Return data with every text as `visible` shows it."""
    if isinstance(data, str):
        return visible(data)
    if isinstance(data, dict):
        return {_visible_in(key): _visible_in(value) for key, value in data.items()}
    return [_visible_in(item) for item in data] if isinstance(data, list | tuple) else data


def _harmless(value: object) -> object:
    """Return the text that a template prints: ours as it is, any other spelt out; jinja2 escapes it afterwards."""
    return visible(value) if type(value) is str else value


def _line_rules(cards: tuple[Card, ...]) -> str:
    """Place each line by its own style rule, since the policy allows no style on an element."""
    return "".join(f"#{plot.id}-line {{ top: {plot.line}%; }}\n" for card in cards for plot in card.plots)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(str(shipped(FOLDER)), encoding="utf-8"),
        autoescape=True,
        finalize=_harmless,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
    )
    environment.filters["code"] = _with_code
    return environment


def _with_code(text: str) -> "Markup":
    """Return a sentence with what stands between backticks as code."""
    from markupsafe import Markup, escape

    *pairs, end = visible(text).split("`")
    if len(pairs) % 2:  # a backtick without its other
        return escape(visible(text))
    words = (
        Markup("<code>{}</code>").format(part) if at % 2 else escape(part) for at, part in enumerate((*pairs, end))
    )
    return Markup().join(words)


def _read(name: str) -> str:
    return shipped_text(f"{FOLDER}/{name}")
