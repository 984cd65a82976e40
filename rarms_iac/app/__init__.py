"""The use cases: one module for each thing that a user wants done, as functions from values to values.

What comes in: a manifest (`manifests.load_manifest`), a selection of its hosts (`hosts.select_hosts`), a frozen
request, and what the caller wants to hear meanwhile (`control`: a `Reporter`, a `StopSignal`). What comes out: a frozen
result with its findings; the caller decides how it is shown and which exit code it means. What ends a use case without
a result is a `UseCaseError` with its findings, or a `RequestError` where it was asked wrongly (`use_case_errors`).
Nothing here knows click, a terminal, or the words of a view, and only `wiring` names concrete providers. Begin with
`planning`.
"""
