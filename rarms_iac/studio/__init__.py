"""The paper's session on a local page: routes, one call into `app`, a template.

What comes in: a manifest, a port, whether anything may be changed. `server` serves the page on the loopback interface
until it is stopped; `guard` bounds who connects and lets one browser of one user in; `knowledge` is what
the page shows, looked up again when a file changed; `actions` makes use cases of what was clicked, and `work` runs them
one at a time. The page is the template of `rarms report` (`views/reports/html`) with what only a server can do. Begin
with `server`.
"""
