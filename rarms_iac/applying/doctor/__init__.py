"""`rarms doctor`: finds what is wrong with a host before anything is planned for it.

In: a host's State and `HostCondition` (`Examination`). Out: diagnostics in the order of their lines. Begin at
`examine`; `windows` checks the operating system, `machines` every virtual machine. Nothing here changes a host.
"""
