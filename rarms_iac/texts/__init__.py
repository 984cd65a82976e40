"""Texts that rooms below `views` need: titles of steps, values as people write them, reasons.

Values of `model/` come in, text goes out; nothing is decided here. A step's title is in plan files, journals, scripts
and the terminal alike, so it is made once, by `plans`, when the step is. `indexes` has measured values and thresholds,
`messages` the words of findings. What only a command shows is in `views/`.
"""
