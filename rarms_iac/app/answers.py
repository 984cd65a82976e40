"""The results that commands print with `--json`: each names itself in `kind` (`schemas/output.json`)."""

from rarms_iac.app.doctor import Examinations
from rarms_iac.app.drift import DriftReport
from rarms_iac.app.status import History, Overview

Answer = DriftReport | Examinations | History | Overview
