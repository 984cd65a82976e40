"""The version that every output carries."""

from typing import Literal

Format = Literal["rarms-output/1"]
FORMAT_VERSION: Format = "rarms-output/1"
