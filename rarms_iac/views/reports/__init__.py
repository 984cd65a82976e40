"""The report in every form: as a page, in the terminal, as CSV and as a spreadsheet.

In comes an `app.report_model.Report`, whose curves were looked up where the planner looks; out goes text or bytes.
Begin with `tables` for the rows that all forms share; then `page` and `html` for the page, `terminal` and
`spreadsheet`. JSON is the `Report` itself. Nothing is computed from samples here, and nothing is decided.
"""
