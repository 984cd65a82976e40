"""`python -m rarms_iac`: the same as `rarms`."""

import sys

from rarms_iac.cli.main import main

sys.exit(main())
