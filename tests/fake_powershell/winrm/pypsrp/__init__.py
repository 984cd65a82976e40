"""What rarms uses of pypsrp, in front of the stand-in of PowerShell: first on the PYTHONPATH of who calls rarms.

Names, parameters and errors are those of pypsrp 0.9.1. What goes over the wire, and what a WinRM service makes of it,
is not here.
"""
