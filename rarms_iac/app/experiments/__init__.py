"""Measuring: the use cases that run components on hosts which are held meanwhile, and what each of them records.

What comes in: the hosts of a manifest, a frozen request, and how the caller takes part (a reporter, a signal to stop,
prompts and consents). What comes out: conclusions with the settings that they rest on; what was measured is in the data
logs, and what follows from it in the configuration logs. Begin with `measure`, which runs one experiment after the
other by `run_experiment`; `tune` does the same for components that might share a partition, and `prove` runs an applied
layout. How a single setting is measured is for `rarms_iac.measuring`, one floor below.
"""
