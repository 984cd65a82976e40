"""Experiments on a host: P1 with components, P2 with an interfering load, one setting after the other.

An experiment (`setup.py`), a method (`methods.py`) with its strategy (`strategies.py`, `search/`), and a
host come in; settings in a data log (`settings_log.py`) and a conclusion (`model/outcomes`) go out. Begin with
`loop.measure_settings`, which has `setting_run.py` run each setting. `partitions.py` makes P1 and P2 and says what a
host can give them, `settling.py` when samples count, `sampling.py` takes them, `evidence.py` says whether something
disturbed a setting, `duration.py` how long it takes, `performance.py` what it shows, `measuring_findings.py` what a
person must hear of the end, and `prove.py` runs an applied layout and judges all of its components together.
"""
