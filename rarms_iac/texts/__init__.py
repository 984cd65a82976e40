"""Text that packages below `views` need: quantities, titles of steps, findings.

Values of `model/` come in, text goes out; nothing is decided here. A step's title is in plan files, journals, scripts
and the terminal alike, so it is made once, by `plans`, when the step is. `findings` fills the templates of findings,
`quantities` and `indexes` write numbers with their units, `messages` has lists, counts, quotes and reasons. Text of a
single command is in `views/`.
"""
