"""Kinds of findings that several rooms report."""

from rarms_iac.model.diagnostics import Finding

MISSING = Finding.error("RARMS016", "Something that is needed here is missing")

DAMAGED = Finding.error("RARMS190", "What the host keeps for rarms is damaged")
FOREIGN_AT_NAME = Finding.error("RARMS150", "Something that rarms did not make is in the way")
GENERATION = Finding.error("RARMS256", "This does not go with the machine's generation")
NOTHING_CHANGED = Finding.note("RARMS174", "Nothing was changed")
NOT_DONE = Finding.error("RARMS179", "The command cannot be done as it is given")
NOT_READ = Finding.error("RARMS001", "A file cannot be read")
NOT_YAML = Finding.error("RARMS007", "Not a YAML text that rarms reads")
NO_EFFECT = Finding.warning("RARMS084", "A setting has no effect")
NO_ORDER = Finding.error("RARMS154", "No order of steps keeps within the host")
NO_RESPONSIVENESS = Finding.error("RARMS227", "SystemResponsiveness cannot be set")
NO_TARGET = Finding.error("RARMS194", "Nothing can be done with this target")
OTHER_VERSION = Finding.error("RARMS410", "Another version of rarms is needed")
OVER_HOST = Finding.error("RARMS061", "More than a host has")
ROUNDED = Finding.warning("RARMS367", "A reserve that is not a whole per cent")
SCRIPT_REFUSED = Finding.error("RARMS251", "A script cannot be written or run")
UNKNOWN_KEY = Finding.error("RARMS015", "A key that is not allowed here")
UNKNOWN_NAME = Finding.error("RARMS042", "Unknown name")
UNUSABLE_RESERVE = Finding.error("RARMS060", "A reserve or processors that could never be used")
WRONG_VALUE = Finding.error("RARMS017", "A value that is not allowed here")
