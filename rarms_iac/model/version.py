"""The version of rarms, which plans and logs carry; `rarms_iac.__version__` for programs."""

__version__ = "0.1.0"
