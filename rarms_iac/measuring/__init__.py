"""Measuring: components run on hosts that are held meanwhile, setting after setting, alone, together or as applied.

The hosts of a manifest, a frozen request, and how the caller takes part come in. Answers go out, with the settings that
they need; data logs record the settings, configuration logs what follows. Begin with `measure`, `tune` and `prove`.
`run_experiment` measures with one load: a strategy (`strategies.py`, `search/`) chooses settings, `setting_run.py` runs
them. `proof.py` runs an applied layout, `run_component.py` single components. `session.py` holds the hosts, and
`stopping.py` stops what runs there meanwhile. `findings.py` has all findings.
"""
