"""The rarms of a robot, called by the rarms of another computer.

In: one request on standard input. Out: on standard output the calls of reporters, then a result or a failure. Begin at
`__main__`; `providers/robot.py` is the other side and has the form of all lines.
"""
